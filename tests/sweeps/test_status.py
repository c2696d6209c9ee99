"""Status of a matrix and time left, against numbers worked out by hand."""

import pyarrow as pa
import pytest

from jbench.store import Results, schema
from jbench.sweeps.cell_status import cell_statuses, seconds_left
from jbench.sweeps.matrix import matrix_cells, read_matrix
from jbench.training.status import (
    failures_among,
    is_being_trained,
    record_failure,
    run_status,
)
from tests.sweep_matrices import write_matrix


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture
def cell(tmp_path, results):
    """Four seeds of TD3, 10,000 control steps each."""
    matrix = read_matrix(write_matrix(tmp_path, seeds="0-3", steps=10_000))
    (cell,) = matrix_cells(matrix, results)
    return cell


def begin(results, run):
    return results.create("run", run.id, run.model_dump(mode="json"))


def finish(results, run, wall_time, together=1):
    """Finishes a run after some seconds, as one of several in its process."""
    record = begin(results, run)
    record.finish({"wall_time": wall_time, "steps_done": run.steps, "together": together})
    return record


def add_episodes(record, run, count):
    rows = [
        {"run": run.id, "episode": n, "control_steps": 1000 * (n + 1), "length": 1000}
        for n in range(count)
    ]
    table = pa.Table.from_pylist(rows, schema.EPISODES)
    record.append({"episodes": table}, {"checkpoint.safetensors": b"x"} if count > 3 else {})


def test_each_status_is_reported_with_the_steps_that_are_left(results, cell):
    finished, partial, failed, _ = cell.runs
    finish(results, finished, 1.0)
    record = begin(results, partial)
    add_episodes(record, partial, 4)  # of ten, with a checkpoint to resume from
    record = begin(results, failed)
    add_episodes(record, failed, 3)  # without one: from the beginning
    record.fail("no luck")
    found = [run_status(run, results) for run in cell.runs]
    assert [each.state for each in found] == ["finished", "partial", "failed", "missing"]
    assert [each.steps_left for each in found] == [0, 6000, 10_000, 10_000]
    assert failures_among(cell.runs, results) == {failed.id: "no luck"}
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    assert (line.finished, line.partial, line.failed, line.missing) == (1, 1, 1, 1)
    assert line.steps_left == 26_000


def test_a_run_whose_manifest_is_damaged_counts_as_failed(results, cell):
    record = begin(results, cell.runs[0])
    (record.path / "manifest.json").write_text("{")
    found = run_status(cell.runs[0], results)
    assert found.state == "failed"
    assert "is not a manifest that can be read" in found.error


def test_the_time_left_is_from_runs_that_were_measured(results, cell):
    # Two runs shared a process for 40 s: 40 s / 10,000 steps / 2 = 2 ms of a core for each step;
    # one was alone for 20 s: 2 ms too.
    for run, wall_time, together in ((cell.runs[0], 40.0, 2), (cell.runs[1], 20.0, 1)):
        finish(results, run, wall_time, together)
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    # 20,000 steps are left: 40 s of a core, on two cores.
    assert (line.seconds_left, line.estimate) == (pytest.approx(20.0), "measured runs")
    assert seconds_left([line], 2) == pytest.approx(20.0)
    # Four seeds give work to four processes, and no more.
    (line,) = cell_statuses([cell], results, jobs=8, quick=False)
    assert line.seconds_left == pytest.approx(10.0)
    assert seconds_left([line], 8) == pytest.approx(5.0)


def test_runs_of_another_machine_measure_nothing(results, cell):
    record = finish(results, cell.runs[0], 40.0)
    elsewhere = {**record.manifest.provenance, "processor": "another"}
    record._commit(record.manifest.model_copy(update={"provenance": elsewhere}))
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    assert (line.seconds_left, line.estimate) == (None, "unknown")
    assert seconds_left([line], 2) is None


def test_what_was_not_measured_is_measured_quickly(results, cell):
    (line,) = cell_statuses([cell], results, jobs=2, quick=True)
    assert line.estimate == "a quick measurement"
    assert line.seconds_left > 0


def test_another_task_of_the_same_settings_will_do(tmp_path, results, cell):
    finish(results, cell.runs[0], 20.0)
    matrix = read_matrix(write_matrix(tmp_path, steps=5000), tasks=["move_to_pose"])
    lines = cell_statuses(matrix_cells(matrix, results), results, jobs=1, quick=False)
    # Two seeds of 5000 steps at 2 ms.
    assert [(line.seconds_left, line.estimate) for line in lines] == [
        (pytest.approx(20.0), "measured runs")
    ]
    ppo = read_matrix(write_matrix(tmp_path, algos='"ppo"'))
    (line,) = cell_statuses(matrix_cells(ppo, results), results, jobs=1, quick=False)
    assert line.estimate == "unknown"


def test_a_failure_is_recorded_once_and_of_no_finished_run(results, cell):
    finished, failed, new, held = cell.runs
    finish(results, finished, 1.0)
    begin(results, failed).fail("the first reason")
    for run in (finished, failed, new):
        record_failure(run, results, "another reason")
    with results.record("run", held.id).lock():
        assert is_being_trained(held, results)
        record_failure(held, results, "another reason")
    assert not is_being_trained(held, results)
    assert [run_status(run, results)[::2] for run in cell.runs] == [
        ("finished", ""),
        ("failed", "the first reason"),
        ("failed", "another reason"),
        ("missing", ""),
    ]
    assert results.find("run", new.id).settings == new.model_dump(mode="json")
