"""Tests of the status of a matrix and its time left, against hand-computed numbers."""

from dataclasses import replace

import pytest

from jbench.errors import WorkError
from jbench.store import Results, locks
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import Cell, matrix_cells
from jbench.sweeps.cell_status import CellStatus, cell_statuses, seconds_left
from jbench.sweeps.executors import Local
from jbench.sweeps.forecasts import forecasts, time_sentence
from jbench.tasks.find import find_task
from jbench.training import speed
from jbench.training.status import failures_among, record_failure, run_status, run_statuses
from tests.store.store_rows import alter_manifest, episodes
from tests.sweep_matrices import runs_of_matrix, write_matrix


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


def finish(results, run, wall_time, together=1, **more):
    """Finishes a run after `wall_time` seconds, as one of `together` runs in its process."""
    record = begin(results, run)
    record.finish({"wall_time": wall_time, "steps_done": run.steps, "together": together, **more})
    return record


def test_each_status_is_reported_with_steps_left(results, cell):
    finished, unfinished, failed, missing = cell.runs
    finish(results, finished, 1.0)
    checkpoint = {"checkpoint.safetensors": b"x"}
    begin(results, unfinished).append({"episodes": episodes(unfinished.id, [0.0] * 4)}, checkpoint)
    record = begin(results, failed)
    record.append({"episodes": episodes(failed.id, [0.0] * 3)})  # no checkpoint: restarts
    record.fail("no luck")
    statuses = [run_status(run, results) for run in cell.runs]
    assert [status.state for status in statuses] == ["finished", "unfinished", "failed", "missing"]
    assert [status.steps_left for status in statuses] == [0, 6000, 10_000, 10_000]
    assert failures_among(run_statuses(cell.runs, results)) == {failed.id: "no luck"}
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    assert (line.finished, line.unfinished, line.failed, line.missing) == (1, 1, 1, 1)
    assert line.steps_left == 26_000
    (begin(results, missing).path / "manifest.json").write_text("{")
    damaged = run_status(missing, results)
    assert damaged.state == "failed"
    assert "is not a manifest that can be read" in damaged.error


def test_time_left_is_estimated_from_finished_runs(results, cell):
    # One of two runs that shared a process for 40 s: 40 s / 10,000 steps / 2 = 2 ms of a core per
    # step; one run alone for 20 s: 2 ms too.
    for run, wall_time, together in ((cell.runs[0], 40.0, 2), (cell.runs[1], 20.0, 1)):
        finish(results, run, wall_time, together)
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    # 20,000 steps remain: 40 s of a core, on two cores.
    assert (line.seconds_left, line.estimate) == (pytest.approx(20.0), "measured runs")
    assert seconds_left([line], 2) == pytest.approx(20.0)
    # Two seeds are left, which occupy at most two processes.
    (line,) = cell_statuses([cell], results, jobs=8, quick=False)
    assert line.seconds_left == pytest.approx(20.0)
    assert seconds_left([line], 8) == pytest.approx(20.0)


def test_other_work_on_the_machine_of_finished_runs_does_not_count(results, cell):
    finish(results, cell.runs[0], 300.0, together=2, processor_time=20.0)
    (line,) = cell_statuses([cell], results, jobs=1, quick=False)
    # 2 ms of a core per step, 30,000 steps.
    assert line.seconds_left == pytest.approx(60.0)


def test_seeds_are_not_divided_among_processes(results, cell):
    finish(results, cell.runs[0], 20.0)
    # Of three seeds at 2 ms a step, one of two processes trains two, 20,000 steps.
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    assert line.seconds_left == pytest.approx(40.0)
    assert seconds_left([line], 2) == pytest.approx(40.0)
    # A second configuration fills the gap: 120 s of a core, on two cores.
    assert seconds_left([line, line], 2) == pytest.approx(60.0)
    (line,) = cell_statuses([cell], results, jobs=8, quick=False)
    assert line.seconds_left == pytest.approx(20.0)


def test_run_that_would_fail_again_keeps_no_process_busy(results, cell):
    finish(results, cell.runs[0], 20.0)
    begin(results, cell.runs[1]).fail("It diverged.", {"diverged": {}})
    # Two seeds at 2 ms a step are left, 10,000 steps each, side by side.
    (line,) = cell_statuses([cell], results, jobs=3, quick=False)
    assert (line.failed, line.steps_left) == (1, 20_000)
    assert line.seconds_left == pytest.approx(20.0)
    assert seconds_left([line], 3) == pytest.approx(20.0)
    # A second configuration fills the gap: 80 s of a core, on two cores.
    assert seconds_left([line, line], 2) == pytest.approx(40.0)


def test_runs_of_other_robots_and_machines_give_no_estimate(results, cell, brief_measurements):
    record = finish(results, cell.runs[0], 40.0)
    task = "dmc:cheetah-run"
    run = cell.runs[1].model_copy(update={"task": task, "specs": find_task(task).specs})
    other = replace(cell, task=task, runs=[run])
    (line,) = cell_statuses([other], results, jobs=1, quick=False)
    assert (line.seconds_left, line.estimate) == (None, "unknown")
    alter_manifest(record, provenance={**record.manifest.provenance, "processor": "another"})
    (line,) = cell_statuses([cell], results, jobs=2, quick=False)
    assert (line.seconds_left, line.estimate) == (None, "unknown")
    assert seconds_left([line], 2) is None
    (line,) = cell_statuses([cell], results, jobs=2, quick=True)
    assert (line.seconds_left > 0, line.estimate) == (True, "a quick measurement")


def test_measurement_here_wins_over_records_and_has_the_seeds_of_a_process(
    results, cell, monkeypatch
):
    finish(results, cell.runs[0], 1000.0)  # as on a slow machine of the same name
    measured = []

    def measure(runs, device, final_episodes):
        measured.append([run.seed for run in runs])
        return 0.002 * len(runs)

    monkeypatch.setattr(speed, "seconds_per_step", measure)
    (line,) = cell_statuses([cell], results, jobs=2)
    assert measured == [[1, 2]]  # of seeds 1 to 3, two share a process
    # 2 ms a control step, 10,000 of each seed, two of them one after the other.
    assert (line.seconds_left, line.estimate) == (pytest.approx(40.0), "a quick measurement")


@pytest.mark.parametrize(
    "error", [WorkError("The speed of this algorithm is not measured."), KeyError("x"), SystemExit]
)
def test_measurement_that_fails_stops_nothing(error, results, cell, monkeypatch):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(speed, "seconds_per_step", fail)
    monkeypatch.setattr(speed, "stepping", fail)
    (line,) = cell_statuses([cell], results, jobs=2, final_episodes=1000)
    assert (line.seconds_left, line.estimate) == (None, "unknown")

    finish(results, cell.runs[0], 1000.0)
    (line,) = cell_statuses([cell], results, jobs=2, final_episodes=1000)
    assert (line.seconds_left, line.estimate) == (pytest.approx(2000.0), "measured runs")
    assert line.evaluating == 0


def test_runs_of_other_lengths_are_measured_on_their_own(tmp_path, results, monkeypatch):
    monkeypatch.setattr(speed, "seconds_per_step", lambda runs, *_, **__: 10 / runs[0].steps)
    cells = []
    for steps in (1000, 5000):
        matrix = read_matrix(write_matrix(tmp_path, seeds="0", steps=steps))
        cells += matrix_cells(matrix, results)
    # 10 s each: their evaluations are as long.
    lines = cell_statuses(cells, results, jobs=1)
    assert [line.seconds_left for line in lines] == pytest.approx([10.0, 10.0])


@pytest.mark.parametrize("verb", ["train", "sweep", "training that begins"])
def test_episodes_of_last_evaluations_that_were_typed_count(
    verb, tmp_path, results, cell, monkeypatch, run_command
):
    measured = []

    def measure(runs, device, final_episodes):
        measured.append(final_episodes)
        return 1.0

    monkeypatch.setattr(speed, "seconds_per_step", measure)
    if verb == "training that begins":
        list(forecasts([cell], results, Local(results, 1, final_episodes=7)))
    else:
        what = write_matrix(tmp_path, seeds="0") if verb == "sweep" else "--seeds=0"
        code, _, err = run_command(
            verb, what, "--dry-run", "--final-episodes", 7, results=results.path
        )
        assert code == 0, err
    assert set(measured) == {7}


def test_time_left_is_estimated_from_runs_on_same_device(results, cell):
    on_gpu, on_cpu, old, _ = cell.runs
    for run, wall_time, made_on in (
        (on_gpu, 10.0, {"device": "cuda"}),
        (on_cpu, 40.0, {"device": "cpu"}),
        (old, 40.0, {}),
    ):
        results.create("run", run.id, run.values, made_on).finish(
            {"wall_time": wall_time, "steps_done": run.steps, "together": 1}
        )
    # 10,000 steps of one seed remain.
    seconds = [
        cell_statuses([cell], results, 1, device, quick=False)[0].seconds_left
        for device in ("cpu", "cuda", "cuda:1")
    ]
    assert seconds == pytest.approx([40.0, 10.0, 10.0])


def test_time_left_is_estimated_from_other_task_with_same_settings(tmp_path, results, cell):
    finish(results, cell.runs[0], 20.0)
    matrix = read_matrix(write_matrix(tmp_path, steps=5000), tasks=["move_to_pose"])
    lines = cell_statuses(matrix_cells(matrix, results), results, jobs=1, quick=False)
    # Two seeds of 5000 steps at 2 ms each.
    assert [line.seconds_left for line in lines] == [pytest.approx(20.0)]
    ppo = read_matrix(write_matrix(tmp_path, algos='"ppo"'))
    (line,) = cell_statuses(matrix_cells(ppo, results), results, jobs=1, quick=False)
    assert line.estimate == "unknown"


def test_failure_is_recorded_once_and_never_for_finished_run(results, cell):
    finished, failed, new, held = cell.runs
    finish(results, finished, 1.0)
    begin(results, failed).fail("the first reason")
    for run in (finished, failed, new):
        record_failure(run, results, "another reason")
    with results.folder("run", held.id).lock():
        assert locks.is_held(results.folder("run", held.id).path)
        record_failure(held, results, "another reason")
    assert not locks.is_held(results.folder("run", held.id).path)
    assert [run_status(run, results)[::2] for run in cell.runs] == [
        ("finished", ""),
        ("failed", "the first reason"),
        ("failed", "another reason"),
        ("missing", ""),
    ]
    assert results.find("run", new.id).settings == new.model_dump(mode="json")


def test_forecast_sums_steps_and_time_over_cells(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, algos='"td3", "ppo"', steps=10_000), tmp_path)
    # Two cells of 20,000 steps, each 40 s on 2 processes: 500 steps/s, 80 s.
    cells = [Cell("face_direction", run.algo, "full", [run], "published") for run in runs[1:3]]
    statuses = [CellStatus(cell, 0, 1, 0, 0, 20_000, 80.0, "measured runs") for cell in cells]
    assert time_sentence(statuses, 2) == (
        "This takes about 1 min 20 s: 2 runs, 40,000 control steps at 500 steps/s, 2 processes at "
        "a time."
    )
    # 60% and 50% of the same time are 55%.
    shares = zip(statuses, (0.6, 0.5), strict=True)
    evaluating = [status._replace(evaluating=share) for status, share in shares]
    assert time_sentence(evaluating, 2).endswith(
        "time. Evaluations take most of it; fewer --evaluate-episodes (in a matrix file, the key "
        "episodes of [evaluation]) make them shorter."
    )
    assert time_sentence([statuses[0]._replace(seconds_left=None)], 2) is None


def test_long_forecast_names_options_that_shorten_it(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, seeds="0-3", steps=400_000), tmp_path)
    status = CellStatus(
        Cell("face_direction", "td3", "full", runs, "published"),
        0,
        0,
        0,
        4,
        1_600_000,
        700.0,
        "measured runs",
    )
    sentence = time_sentence([status], 2)
    # Four seeds share the two processes, so the sweep takes the 700 s of the cell.
    assert "at 2,286 steps/s" in sentence
    shorter = "fewer --steps (such as 300000), or fewer --seeds (such as 0-2)."
    assert sentence.startswith("This takes about 11 min 40 s: 4 runs")
    assert sentence.endswith(f" For less: {shorter}")
