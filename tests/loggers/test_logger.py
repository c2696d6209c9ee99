"""Tests that committed rows are copied to experiment trackers, read by the trackers' readers."""

import json
import os
import struct
import subprocess
import sys
import threading

import pyarrow as pa
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.tensorboard import SummaryWriter

from jbench.cli import main
from jbench.commands import training
from jbench.errors import RequestError
from jbench.loggers.logger import Logger, copying_rows, make_logger
from jbench.store import Results, schema
from tests.store.store_rows import episodes
from tests.store.store_whole import add_whole_run, restart


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


def copied(results, run, name="tensorboard", warn=pytest.fail):
    """Copies a run to a tracker during a block."""
    return copying_rows(results, [run.id], make_logger(name, results.path), warn)


def mirror(*arguments, **options):
    with copied(*arguments, **options):
        pass


def scalars(results, run, tag):
    """The (control steps, value) pairs that TensorBoard reads."""
    events = EventAccumulator(str(results.path / "tensorboard" / run.id))
    events.Reload()
    return [(event.step, event.value) for event in events.Scalars(tag)]


def evaluation(run, control_steps, returns):
    common = {"run": run.id, "evaluation": 0, "control_steps": control_steps, "length": 1000}
    rows = [
        {**common, "episode": episode, "episode_return": value, "wall_time": 9.0}
        for episode, value in enumerate(returns)
    ]
    return {"evaluations": pa.Table.from_pylist(rows, schema.EVALUATIONS)}


def test_tensorboard_has_rows_committed_before_and_during_block(results):
    run = add_whole_run(results, [1.0, 2.0], finish=False)
    other = add_whole_run(results, [8.0], seed=1)
    mirror(results, run)
    with copied(results, run):  # each point is logged once
        rows = episodes(run.id, [0, 0, 3.0]).slice(2).to_pylist()
        rows[0] |= {"critic_loss": 0.5, "actor_loss": float("nan")}
        run.append({"episodes": pa.Table.from_pylist(rows, schema.EPISODES)})
        run.append(evaluation(run, 3000, [10.0, 20.0]))
        run.finish({"wall_time": 10.0})
    expected = [(1000, 1.0), (2000, 2.0), (3000, 3.0)]
    assert scalars(results, run, "training/episode_return") == expected
    assert scalars(results, run, "evaluation/mean_return") == [(3000, 15.0)]
    assert scalars(results, run, "losses/critic_loss") == [(3000, 0.5)]
    with pytest.raises(KeyError):
        scalars(results, run, "losses/actor_loss")
    assert not (results.path / "tensorboard" / other.id).exists()
    assert main(["verify", "--results", str(results.path)]) == 0


def test_rows_before_restart_are_hidden(results):
    run = add_whole_run(results, [1.0, 2.0], finish=False)
    mirror(results, run)
    restart(run)
    run.append({"episodes": episodes(run.id, [5.0])})
    mirror(results, run)
    assert scalars(results, run, "training/episode_return") == [(1000, 5.0)]


def test_failing_tracker_stops_logging_with_warning(results):
    run = add_whole_run(results, [1.0])
    (results.path / "tensorboard").write_text("not a directory")
    warnings = []
    mirror(results, run, warn=warnings.append)
    (warning,) = warnings
    assert warning.startswith("Logging has stopped (")


class Kept(Logger):
    """A tracker whose library prints; `ended` are the runs whose logs it has ended."""

    where = "Nowhere."

    def __init__(self, failing=(), exiting=()):
        super().__init__()
        self.begun = threading.Event()
        self.printed = threading.Event()
        self.failing = failing
        self.exiting = exiting
        self.ended = []

    def _begin(self, name, group, config):
        self.begun.set()
        assert self.printed.wait(60)
        print("from the library")
        return name

    def _add(self, log, steps, time, values):
        if log in self.failing:
            raise OSError("no connection")

    def _finish(self, log):
        self.ended.append(log)
        if log in self.exiting:
            sys.exit("no connection")


def test_output_of_the_program_stays_its_own(results, capsys):
    run = add_whole_run(results, [1.0])
    kept = Kept()
    with copying_rows(results, [run.id], kept, pytest.fail):
        assert kept.begun.wait(60)
        print("from the loop")
        kept.printed.set()
    printed = capsys.readouterr()
    assert "from the loop\n" in printed.out
    assert printed.err == ""


def test_output_of_a_tracker_is_no_part_of_a_document(results, capsys, monkeypatch):
    run = add_whole_run(results, [1.0])
    kept = Kept()
    kept.printed.set()

    def sweep(*arguments, **options):
        assert kept.begun.wait(60)
        return {}

    monkeypatch.setattr(training, "make_logger", lambda name, path: kept)
    monkeypatch.setattr(training, "all_runs", lambda cells: [run])
    monkeypatch.setattr(training, "sweep", sweep)
    monkeypatch.setattr(training.output, "is_json", True)
    with training.output.documents_alone():
        training.train_cells([], results, list, "wandb")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "from the library\n" in printed.err


def test_logs_are_ended_after_a_failure(results):
    runs = [add_whole_run(results, [1.0], seed=seed, finish=False) for seed in range(3)]
    ids = [run.id for run in runs]
    kept = Kept(failing=ids[2:], exiting=ids[:1])
    kept.printed.set()
    warnings = []
    with copying_rows(results, ids, kept, warnings.append):
        pass
    assert kept.ended == ids
    (warning,) = warnings
    assert warning.startswith("Logging has stopped (OSError: no connection, line ")
    assert warning.endswith("); the training is not affected.")


def test_log_that_can_not_begin_is_closed(results, monkeypatch):
    run = add_whole_run(results, [1.0])
    closed = []

    def fail(writer, *arguments):
        raise OSError("disk full")

    close = SummaryWriter.close
    monkeypatch.setattr(SummaryWriter, "add_text", fail)
    monkeypatch.setattr(SummaryWriter, "close", lambda writer: closed.append(close(writer)))
    warnings = []
    mirror(results, run, warn=warnings.append)
    assert closed == [None]
    assert warnings[0].startswith("Logging has stopped (OSError: disk full, line ")


@pytest.mark.parametrize(
    ("library", "said"),
    [
        ("raise AttributeError('np.bool8')", "(AttributeError: np.bool8, line 1 of trackio.py)"),
        ("import not_there", "--log trackio needs the package not_there; type pip install"),
    ],
)
def test_library_that_can_not_be_imported_is_said_in_a_sentence(
    results, monkeypatch, tmp_path, library, said
):
    (tmp_path / "trackio.py").write_text(library)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "trackio", raising=False)
    monkeypatch.delenv("TRACKIO_DIR", raising=False)
    with pytest.raises(RequestError) as refused:
        make_logger("trackio", results.path)
    monkeypatch.delenv("TRACKIO_DIR")
    assert said in str(refused.value)
    assert "pip install 'jbench[trackio]'" in str(refused.value)


def records(content):
    """The records of a W&B file, which is a LevelDB log of one block (32 KiB)."""
    assert len(content) < 32768
    first = 7  # the file's header
    while first < len(content):
        length, kind = struct.unpack_from("<HB", content, first + 4)  # after the checksum
        assert kind == 1  # a complete record
        yield content[first + 7 : first + 7 + length]
        first += 7 + length


def test_wandb_logs_each_point_offline(results, monkeypatch):
    pytest.importorskip("wandb")
    from wandb.proto import wandb_internal_pb2

    monkeypatch.setenv("WANDB_MODE", "offline")
    run = add_whole_run(results, [1.0, 2.0])
    mirror(results, run, name="wandb")
    (path,) = (results.path / "wandb").rglob("*.wandb")
    points = []
    for data in records(path.read_bytes()):
        record = wandb_internal_pb2.Record()
        record.ParseFromString(data)
        if record.WhichOneof("record_type") == "run":
            assert record.run.display_name == run.id
        if record.WhichOneof("record_type") == "history":
            items = {item.key or ".".join(item.nested_key): item for item in record.history.item}
            values = (items["control_steps"], items["training/episode_return"])
            points.append(tuple(float(item.value_json) for item in values))
    assert points == [(1000, 1.0), (2000, 2.0)]


# trackio reads TRACKIO_DIR when it is imported, so a separate process logs and reads.
LOGGED_BY_TRACKIO = """
import json, sys
from pathlib import Path
from jbench.loggers.logger import make_logger, copying_rows
from jbench.store import Results

results, run = Results(Path(sys.argv[1])), sys.argv[2]
for _ in range(2):
    with copying_rows(results, [run], make_logger("trackio", results.path), sys.exit):
        pass
from trackio import Api
from trackio.sqlite_storage import SQLiteStorage

(found,) = Api().runs("jbench")
logs = SQLiteStorage.get_logs("jbench", found.name, run_id=found.id)
print(json.dumps({"name": found.name, "config": found.config, "logs": logs}))
"""


def test_trackio_has_each_point_once_after_logging_twice(results):
    pytest.importorskip("trackio")
    run = add_whole_run(results, [1.0, 2.0], finish=False)
    run.append(evaluation(run, 2000, [10.0, 20.0]))
    run.finish({"wall_time": 10.0})
    done = subprocess.run(
        [sys.executable, "-c", LOGGED_BY_TRACKIO, str(results.path), run.id],
        capture_output=True,
        text=True,
        env={name: value for name, value in os.environ.items() if name != "TRACKIO_DIR"},
    )
    assert done.returncode == 0, done.stderr
    # The library prints, too.
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["name"] == run.id
    assert found["config"]["algo"] == run.settings["algo"]
    assert len(found["logs"]) == 3
    for name, wanted in (
        ("training/episode_return", [(1000, 1.0), (2000, 2.0)]),
        ("evaluation/mean_return", [(2000, 15.0)]),
    ):
        assert sorted((log["step"], log[name]) for log in found["logs"] if name in log) == wanted
    assert list((results.path / "trackio").glob("jbench*.db"))
