"""Tests of what Ctrl-C says: what is kept of datasets, encoders, runs and reports."""

import pytest

from jbench.commands.stopped import (
    stopped_cells,
    stopped_collection,
    stopped_encoders,
    stopped_report,
)
from jbench.commands.training import check_failures, show_runs
from jbench.datasets import collect, find_dataset
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import WorkError
from jbench.store import Results
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import matrix_cells
from tests.short_episodes import short_episodes

BEGINS_AGAIN = "the same command begins again."
CONTINUES = "the same command continues there."


@pytest.fixture(scope="module", autouse=True)
def short():
    with short_episodes(50):
        yield


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture
def cells(tmp_path, results):
    """Two runs, each of which needs an encoder of its own and one dataset of 15 episodes."""
    file = tmp_path / "matrix.toml"
    file.write_text(
        """
        tasks = ["face_direction"]
        algos = ["td3"]
        representations = ["dae3"]
        seeds = "0-1"
        steps = 1000
        dataset.steps = 750
        encoder.seed = "each"
        encoder.options.dae.epochs = 4
        """
    )
    return matrix_cells(read_matrix(str(file)), results)


class StoppedError(Exception):
    """In place of Ctrl-C."""


def stop_when(condition):
    """Returns a progress function that stops the work when a condition is true."""

    def progress(done):
        if condition():
            raise StoppedError

    return progress


def test_what_is_kept_of_a_sweep_is_its_dataset_then_its_encoders_then_its_runs(cells, results):
    (cell,) = cells
    nothing = f"No control step is kept yet; {BEGINS_AGAIN}"
    first = "No run has begun: the dataset is made first."
    assert stopped_collection(cell.dataset, results) == nothing
    assert stopped_cells(cells, results) == f"{first} {nothing}"

    def episodes():
        return results.find("dataset", cell.dataset.id).rows("dataset_episodes")

    # Ten episodes of 50 control steps are a commit.
    with pytest.raises(StoppedError):
        collect(cell.dataset, results, 1, stop_when(episodes))
    some = f"500 of 750 control steps are kept; {CONTINUES}"
    assert stopped_collection(cell.dataset, results) == some
    assert stopped_cells(cells, results) == f"{first} {some}"

    collect(cell.dataset, results, 1)
    nothing = f"No epoch is kept yet; {BEGINS_AGAIN}"
    first = "No run has begun: encoders are made first."
    assert stopped_cells(cells, results) == f"{first} {nothing}"

    dataset = find_dataset(results, cell.dataset.id)
    begun, other = cell.encoders
    states = States(dataset, begun.task, begun.seed)

    def has_three_epochs():
        return results.find("encoder", begun.id).rows("encoder_epochs") == 3

    with pytest.raises(StoppedError):
        train_encoder(begun, states, results, stop_when(has_three_epochs), commit_every=0)
    assert stopped_encoders([begun], results) == f"3 of 4 epochs are kept; {CONTINUES}"
    some = f"3 of 4 epochs of {begun.id} are kept; {CONTINUES}"
    assert stopped_cells(cells, results) == f"{first} {some}"

    train_encoder(begun, states, results)
    assert stopped_encoders([begun], results) == "1 encoder is finished."
    some = "Of 2 encoders, 1 is finished and 0 begun; the same command trains the others."
    assert stopped_encoders([begun, other], results) == some

    train_encoder(other, States(dataset, other.task, other.seed), results)
    assert stopped_cells(cells, results) == f"No run has begun yet; {BEGINS_AGAIN}"

    run, last = cell.runs
    results.create("run", run.id, run.model_dump(mode="json")).finish({})
    some = "Of 2 runs, 1 is finished and 0 begun; the same command trains the others."
    assert stopped_cells(cells, results) == some
    results.create("run", last.id, last.model_dump(mode="json")).finish({})
    assert stopped_cells(cells, results) == "2 runs are finished."


def test_run_that_failed_for_want_of_space_needs_no_option(cells, results):
    (run, _) = cells[0].runs
    record = results.create("run", run.id, run.model_dump(mode="json"))
    # A full disk leaves it unfinished.
    with pytest.raises(WorkError, match="1 of 2 runs failed; the same command tries again"):
        check_failures([run.id], 2, results)
    record.fail("a worker died")
    with pytest.raises(WorkError, match="1 of 2 runs failed; --retry-failed tries again"):
        check_failures([run.id], 2, results)


def test_option_that_would_change_nothing_is_not_suggested(cells, results):
    """An agent that diverged does so again."""
    run, other = cells[0].runs
    record = results.create("run", run.id, run.model_dump(mode="json"))
    record.fail("its agent diverged", {"diverged": {"control_steps": 40}})
    same = "1 of 2 runs failed; the same numbers, code and machine make the same error again.$"
    with pytest.raises(WorkError, match=same):
        check_failures([run.id], 2, results)
    results.create("run", other.id, other.model_dump(mode="json")).fail("a worker died")
    with pytest.raises(WorkError, match="2 of 2 runs failed; --retry-failed tries again"):
        check_failures([run.id, other.id], 2, results)


def test_earlier_report_is_named_only_if_there_is_one(tmp_path):
    assert stopped_report(tmp_path) == f"No report is written yet; {BEGINS_AGAIN}"
    (tmp_path / "index.html").write_text("a page")
    kept = f"The earlier report in {tmp_path} is still there; the same command writes the new one."
    assert stopped_report(tmp_path) == kept


def test_runs_of_which_nothing_is_recorded_have_no_table(cells, results, capsys):
    show_runs(cells[0].runs, results)
    assert capsys.readouterr().out == ""
