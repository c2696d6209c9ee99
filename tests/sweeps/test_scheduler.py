"""Tests of sweeps started from Python, without the command line."""

import json
import re
import subprocess
import sys
from itertools import chain

import pytest

from jbench.cli import main
from jbench.errors import RequestError
from jbench.settings.records import OFESettings
from jbench.store import Results
from jbench.studies.matrix import read_matrix
from jbench.sweeps.batches import batches
from jbench.sweeps.cell import all_runs, matrix_cells
from jbench.sweeps.cell_status import cell_statuses
from jbench.sweeps.scheduler import sweep
from jbench.tasks.find import find_task
from jbench.tasks.task import DOES_NOT_REPEAT
from jbench.training.events import Finished, Note, Warned
from tests.command_line import SHORT, with_short_episodes
from tests.sweep_matrices import runs_of_matrix, states, write_matrix
from tests.training.test_batched_run import ENCODED, settings

# A sweep whose events are kept, and the same sweep again.
PROGRAM = """
import json, sys, threading
from pathlib import Path
from jbench.sweeps.executors import Local
from jbench.sweeps.cell import matrix_cells
from jbench.studies.matrix import read_matrix
from jbench.sweeps.scheduler import sweep
from jbench.store import Results

matrix, results = sys.argv[1], Results(Path(sys.argv[2]))
events = []

def keep(event):
    assert threading.current_thread() is threading.main_thread()
    values = vars(event)
    about = values | {"runs": len(values.get("runs", ()))}
    events.append((type(event).__name__, about))

cells = matrix_cells(read_matrix(matrix), results)
assert sweep(cells, results, lambda: Local(results, jobs=1), keep) == {}
assert sweep(cells, results) == {}
commands = ("jbench.cli", "jbench.commands")
of_the_command_line = [name for name in sys.modules if name.startswith(commands)]
print(json.dumps([events, of_the_command_line]))
"""


@pytest.mark.slow
def test_program_sweeps_without_command_line_and_receives_events(tmp_path):
    matrix = write_matrix(tmp_path, representations='"pca3"', seeds="0", steps=1000, dataset=1000)
    results = tmp_path / "results"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, matrix, str(results)],
        capture_output=True,
        text=True,
        env=with_short_episodes(tmp_path),
    )
    assert done.returncode == 0, done.stderr
    events, of_the_command_line = json.loads(done.stdout)
    assert of_the_command_line == []
    sentences = [about["text"] for kind, about in events if kind == "Note"]
    assert "1 run, 1,000 control steps at " in sentences[-1]
    progress = [(about["work"], about["done"]) for kind, about in events if kind == "Progress"]
    assert progress[0] == ("collect", 0)
    assert progress[-1] == ("pca3 face_direction", 1)
    rest = [(kind, about.get("control_steps", 0), about["runs"]) for kind, about in events]
    assert [event for event in rest if event[0] not in ("Note", "Progress")] == [
        ("TrainingBegan", 0, 1),
        ("ProcessStarted", 0, 1),
        *(("EpisodeEnded", control_steps, 0) for control_steps in range(SHORT, 1001, SHORT)),
        ("Finished", 0, 0),
        ("ProcessEnded", 0, 1),
    ]
    assert states(runs_of_matrix(matrix, results), results) == ["finished"]


def texts(events, kind):
    return [event.text for event in events if isinstance(event, kind)]


class Gpu:
    """An executor with a GPU whose first process dies.

    Attributes:
        given: the runs of each process.
    """

    jobs, device = 1, "cuda"

    def __init__(self):
        self.given = []

    def train(self, runs):
        self.given.append(runs)
        yield from [] if len(self.given) == 1 else [Finished(r.id) for r in runs]

    def stop(self):
        """Does nothing."""


def test_gpu_trains_the_seeds_of_a_configuration_in_one_process(tmp_path):
    matrix, events, gpu = write_matrix(tmp_path, algos='"td3", "ppo"'), [], Gpu()
    tasks = ["face_direction", "move_to_pose"]
    cells = matrix_cells(read_matrix(matrix, tasks=tasks), Results(tmp_path))
    assert sweep(cells, Results(tmp_path), lambda: gpu, events.append) == {}
    assert [len(cell.runs) for cell in cells] == [2, 2, 2, 2]
    assert gpu.given == [cell.runs for cell in (*cells, cells[0])]
    assert texts(events, Note) == [
        "The process of seeds 0, 1 of td3 face_direction full died; they are tried again."
    ]


class Crashing(Gpu):
    """An executor whose processes die if they train seed 0."""

    device = "cpu"

    def train(self, runs):
        self.given.append([run.seed for run in runs])
        dies = any(run.seed == 0 for run in runs)
        yield from [] if dies else [Finished(r.id) for r in runs]


def test_run_whose_process_dies_is_one_in_the_message(tmp_path):
    matrix, events, executor = write_matrix(tmp_path, seeds="1"), [], Gpu()
    cells = matrix_cells(read_matrix(matrix), Results(tmp_path))
    assert sweep(cells, Results(tmp_path), lambda: executor, events.append) == {}
    assert texts(events, Note) == [
        "The process of seed 1 of td3 face_direction full died; it is tried again."
    ]


def test_run_that_kills_its_process_fails_no_other_run(tmp_path):
    matrix, events, executor = write_matrix(tmp_path, seeds="0-2"), [], Crashing()
    cells = matrix_cells(read_matrix(matrix), Results(tmp_path))
    failures = sweep(cells, Results(tmp_path), lambda: executor, events.append)
    assert failures == {cells[0].runs[0].id: "its process died without a message, 3 times"}
    assert executor.given == [[0, 1, 2], [0, 1, 2], [0], [1], [2]]
    died = "The process of seeds 0, 1, 2 of td3 face_direction full died;"
    assert texts(events, Note) == [
        f"{died} they are tried again.",
        f"{died} each is tried again in a process of its own.",
    ]


@pytest.fixture
def with_damaged_encoder(tmp_path):
    """Returns a command that sweeps where dataset and encoder are damaged, and their two ids."""
    results = Results(tmp_path)
    matrix = write_matrix(tmp_path, representations='"pca3", "full"')
    encoder = matrix_cells(read_matrix(matrix), results)[0].encoders[0]
    for kind, id in (("dataset", encoder.dataset), ("encoder", encoder.id)):
        folder = results.folder(kind, id)
        folder.path.mkdir(parents=True)
        (folder.path / "manifest.json").write_text("{")
    return ["sweep", matrix, "--results", str(tmp_path), "--json"], [encoder.dataset, encoder.id]


def test_damaged_dataset_and_encoder_would_be_made_first(with_damaged_encoder, capsys):
    typed, ids = with_damaged_encoder
    assert main([*typed, "--dry-run"]) == 0
    assert json.loads(capsys.readouterr().out)["made_first"] == ids


def test_time_left_is_without_what_is_made_first_and_a_smaller_dataset_is_advised(
    tmp_path, run_command, brief_measurements
):
    matrix = write_matrix(tmp_path, representations='"full", "pca3"')
    code, printed, _ = run_command("sweep", matrix, "--dry-run", results=tmp_path / "results")
    printed = " ".join(printed.split())
    assert code == 0
    assert re.search(
        r"Time left with \d+ process(es)? at a time: .*, without the datasets", printed
    )
    assert f"4,000 control steps; steps under [dataset] in {matrix} makes it smaller." in printed

    matrix = write_matrix(tmp_path)
    code, printed, _ = run_command("sweep", matrix, "--dry-run", results=tmp_path / "results")
    assert (code, "without the datasets" in printed) == (0, False)


@pytest.mark.slow
def test_damaged_dataset_or_encoder_stops_no_other_cell(with_damaged_encoder, capsys):
    typed, _ = with_damaged_encoder
    assert main(typed) == 1
    printed = capsys.readouterr()
    assert "manifest.json is not a manifest that can be read" in printed.err
    cells = json.loads(printed.out)["configurations"]
    assert {cell["representation"]: cell["finished"] for cell in cells} == {"pca3": 0, "full": 2}


def test_runs_without_dataset_fail_and_start_no_process(tmp_path, monkeypatch):
    matrix = read_matrix(write_matrix(tmp_path, representations='"pca3"'))
    cells = matrix_cells(matrix, Results(tmp_path))
    (tmp_path / "datasets").mkdir()
    (tmp_path / "datasets" / "random").write_text("a file where a directory belongs")
    events = []
    monkeypatch.setattr("jbench.sweeps.executors._start", lambda: pytest.fail("it started"))
    failures = sweep(cells, Results(tmp_path), report=events.append)
    assert list(failures) == [run.id for run in cells[0].runs]
    for reason in failures.values():
        assert reason.startswith("its dataset can't be collected:")
    (warning,) = texts(events, Warned)
    assert warning.startswith(f"the runs on {cells[0].encoders[0].id} are left out: its dataset")


def test_task_that_does_not_repeat_is_warned_of_once_before_its_training(tmp_path):
    task, events = "tests.gym_tasks:drifts", []
    matrix = tmp_path / "lab.toml"
    matrix.write_text(f'tasks = ["{task}"]\nalgos = ["td3", "ppo"]\nsteps = 1000\nseeds = "0"\n')
    results = Results(tmp_path / "results")

    def no_executor():
        raise RequestError("Here the training would begin.")

    with pytest.raises(RequestError, match="would begin"):
        sweep(matrix_cells(read_matrix(str(matrix)), results), results, no_executor, events.append)
    assert events == [Warned(f"{task}: {DOES_NOT_REPEAT}.")]


def test_task_is_tried_only_if_a_run_of_it_is_new(tmp_path):
    task, results = "tests.third_party_task.own_tasks:NotFinite", Results(tmp_path / "results")
    matrix = tmp_path / "lab.toml"
    matrix.write_text(f'tasks = ["{task}"]\nalgos = ["td3"]\nsteps = 1000\nseeds = "0"\n')
    cells = matrix_cells(read_matrix(str(matrix)), results)
    for begin in (lambda: sweep(cells, results), lambda: cell_statuses(cells, results, 1)):
        with pytest.raises(RequestError, match="height of its observation is not finite"):
            begin()
    assert not list(tmp_path.rglob("manifest.json"))
    (run,) = all_runs(cells)
    results.create("run", run.id, run.values).finish({"steps_done": 1000})
    assert sweep(cells, results) == {}


def test_seeds_of_configuration_share_process_on_gpu_and_are_divided_on_cpu():
    kinds = (
        {"task": "face_direction"},
        {"task": "move_from_origin"},
        ENCODED,
        {"representation": "ofe6", "ofe": OFESettings(units=6, layers=2)},
        {"precision": "bfloat16"},
        {"augment": 1},
        {"task": "dmc:cheetah-run", "specs": find_task("dmc:cheetah-run").specs},
    )
    configurations = [[settings("td3", seed, **kind) for seed in (0, 3, 4)] for kind in kinds]
    others = [[settings("td3", seed, engine="sb3")] for seed in (0, 3)]
    runs = list(chain(*configurations, *others))
    for jobs, device in ((1, "cuda"), (4, "cuda"), (1, "cpu")):
        assert batches(runs, jobs, device) == [*configurations, *others]
    halves = [part for seeds in configurations for part in (seeds[:2], seeds[2:])]
    assert batches(runs, 2, "cpu") == [*halves, *others]
