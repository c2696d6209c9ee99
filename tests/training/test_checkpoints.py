"""Tests of training checkpoints: which are kept, which are rejected, and where a run resumes."""

import errno
import functools
import json
import os
import re
import shutil
from pathlib import Path

import pytest
import safetensors.torch
import torch

from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.environments import Environments
from jbench.store import Results
from jbench.training import log, replay_pieces
from jbench.training.batched_run import run_batch
from jbench.training.checkpoints import load
from jbench.training.events import EpisodeEnded
from jbench.training.replay_pieces import stored_rows
from tests.store.test_damage import flip_a_byte
from tests.training.small_runs import train_batch
from tests.training.test_resume import outcome, settings


class Stopped(BaseException):
    """Stops a run, like Ctrl-C."""


pytestmark = pytest.mark.usefixtures("short_episodes")

do = functools.partial(train_batch, checkpoint_every=0, final_episodes=1)

UNREADABLE = "can't be read (Input/output error)"


def stop_at(path, runs, steps, **more):
    """Trains runs until one of them passes the given control step."""

    def stop(event):
        if isinstance(event, EpisodeEnded) and event.control_steps > steps:
            raise Stopped

    with pytest.raises(Stopped):
        do(path, runs, report=stop, **more)


def test_first_episode_is_committed_at_once(tmp_path):
    runs = [settings("td3", 1, steps=400)]
    stop_at(tmp_path, runs, 199, checkpoint_every=1000)
    assert only(tmp_path, runs[0]).rows("episodes") == 1


def test_run_that_is_not_restored_leaves_no_open_environments(tmp_path, monkeypatch):
    run = settings("td3", 1, steps=400)
    stop_at(tmp_path, [run], 150)
    closed = []
    close = Environments.close

    def fail(engine, states):
        assert closed == []
        raise OSError("no state")

    def note(environments):
        closed.append(environments)
        close(environments)

    monkeypatch.setattr(OffPolicyEngine, "restore", fail)
    monkeypatch.setattr(Environments, "close", note)
    (error,) = run_batch([run], Results(tmp_path)).values()
    assert str(error) == "no state"
    assert len(closed) == 1


def only(path, run):
    return Results(path).find("run", run.id)


def find_file(record, prefix, number):
    """Returns the path of the `number`-th file of a role or a table, in the order of writing."""
    names = [f.name for f in record.manifest.files if (f.role or f.name).startswith(prefix)]
    return record.path / names[number]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A run stopped after 250 of 300 control steps, and the outcome of the uninterrupted run."""
    path, run = tmp_path_factory.mktemp("both"), settings("td3", 1, steps=300)
    stop_at(path / "stopped", [run], 250)
    do(path / "uninterrupted", [run])
    return path / "stopped", run, outcome(path / "uninterrupted", run)


@pytest.fixture
def stopped(both, tmp_path):
    """A copy of the stopped run that may be changed."""
    path, *rest = both
    shutil.copytree(path, tmp_path / "stopped")
    return tmp_path / "stopped", *rest


@pytest.mark.parametrize(
    ("function", "which", "code", "message"),
    [
        ("open", "checkpoint-", errno.EMFILE, "can't be read (Too many open files)"),
        ("open", "replay-", errno.EIO, UNREADABLE),
        pytest.param("open", "episodes-", errno.EIO, UNREADABLE, marks=pytest.mark.slow),
        pytest.param("open", "manifest.json", errno.EIO, UNREADABLE, marks=pytest.mark.slow),
        # The resume, which is recorded before the training, finds no room.
        ("replace", "manifest.json", errno.ENOSPC, "No room left to write manifest.json"),
    ],
)
def test_checkpoint_is_kept_after_passing_error(
    stopped, function, which, code, message, monkeypatch
):
    path, run, uninterrupted = stopped
    before = only(path, run).roles()
    file = max(p for p in only(path, run).path.iterdir() if p.name.startswith(which))
    real = getattr(os, function)

    def failing(*arguments, **named):
        if file in arguments:
            raise OSError(code, os.strerror(code))
        return real(*arguments, **named)

    with monkeypatch.context() as patched:
        patched.setattr(os, function, failing)
        failures = run_batch([run], Results(path), checkpoint_every=0)
    assert message in str(failures[run.id])
    assert only(path, run).roles() == before
    assert do(path, [run]) == [(1, 250, "")]
    assert outcome(path, run) == uninterrupted


def test_newest_two_checkpoints_are_kept_with_their_rows(stopped):
    path, run, uninterrupted = stopped
    record = only(path, run)
    assert sum(role.startswith("checkpoint-") for role in record.roles()) == 2
    checkpoint, refused = load(record)
    assert refused == []
    assert checkpoint.is_newest
    position = checkpoint.position
    # One evaluation at 150; that at 300 is still due.
    assert (position.control_steps, position.episodes) == (250, 5)
    assert (position.evaluations, position.last_evaluation) == (1, 150)
    assert record.rows("episodes") == 5
    # 5 episodes of 50 steps: 51 rows each.
    assert checkpoint.replay_row == 255
    assert stored_rows(record, 255).shape == (1, 255, 18)
    assert do(path, [run]) == [(1, 250, "")]
    assert outcome(path, run) == uninterrupted


@pytest.mark.parametrize(
    ("prefix", "number", "change", "steps", "reason"),
    [
        (
            "checkpoint-",
            -1,
            flip_a_byte,
            200,
            "at 250 control steps is not used: .*checksum differs",
        ),
        ("replay-", -1, Path.unlink, 200, "No such file"),
        # Both checkpoints need the first piece of the replay buffer.
        ("replay-", 0, flip_a_byte, 0, "is not used: .* is not used: "),
        ("episodes-", 0, flip_a_byte, 0, "its checksum differs"),
    ],
)
def test_run_resumes_where_all_its_files_are_intact(stopped, prefix, number, change, steps, reason):
    path, run, uninterrupted = stopped
    change(find_file(only(path, run), prefix, number))
    ((_, resumed_at, sentence),) = do(path, [run])
    assert resumed_at == steps
    assert re.search(reason, sentence)
    assert outcome(path, run) == uninterrupted


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            {"run": "face_direction/td3/full/s09-00000000"},
            "it belongs to face_direction/td3/full/s09",
        ),
        ({"format": 99}, "it has format 99, but this jbench reads 1 and 2"),
        ({"scalars": 3}, "its header is invalid"),
    ],
)
def test_checkpoint_of_other_run_or_format_is_refused(stopped, changes, reason):
    path, run, uninterrupted = stopped
    record = only(path, run)
    role = [role for role in record.roles() if role.startswith("checkpoint-")][-1]
    tensors = safetensors.torch.load(record.read_file(role))
    printed = {**json.loads(bytes(tensors["envelope"].numpy())), **changes}
    content = bytearray(json.dumps(printed).encode())
    tensors["envelope"] = torch.frombuffer(content, dtype=torch.uint8)
    record.append({}, {role: safetensors.torch.save(tensors)})
    ((_, steps, sentence),) = do(path, [run])
    assert steps == 200
    assert reason in sentence
    assert outcome(path, run) == uninterrupted


@pytest.mark.slow
def test_seeds_stopped_at_different_steps_resume_together(tmp_path):
    runs = [settings("ddpg", seed, steps=250) for seed in (0, 3, 5)]
    do(tmp_path / "uninterrupted", runs)
    path = tmp_path / "stopped"
    stop_at(path, runs[:1], 150)
    stop_at(path, runs[1:2], 50)
    # Seed 5 was never started and is new.
    assert sorted(do(path, runs)) == [(0, 150, ""), (3, 50, "")]
    for run in runs:
        assert outcome(path, run) == outcome(tmp_path / "uninterrupted", run)


def test_resume_with_other_versions_is_reported(stopped):
    path, run, _ = stopped
    record = only(path, run)
    known = record.manifest.provenance
    packages = {**known["packages"], "torch": "2.0.0"}
    record._update(provenance={**known, "packages": packages, "processor": "a toaster"})
    ((_, steps, sentence),) = do(path, [run])
    assert steps == 250
    assert "torch 2.0.0 is now" in sentence
    assert "processor a toaster is now" in sentence


@pytest.mark.slow
def test_number_of_files_of_run_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr(log, "_MAX_PARTS", 3)
    monkeypatch.setattr(replay_pieces, "_MAX_PIECES", 2)
    run = settings("ddpg", 1)  # its replay buffer overwrites rows after 125 steps
    do(tmp_path / "uninterrupted", [run], checkpoint_every=1000)
    stop_at(tmp_path / "stopped", [run], 300)
    record = only(tmp_path / "stopped", run)
    assert len(record.parts("episodes")) <= 3
    numbers = record.read("episodes")["episode"].to_pylist()
    assert numbers == list(range(6))
    # A third piece is not merged, because some of its rows have expired.
    assert sum(role.startswith("replay-") for role in record.roles()) <= 3
    assert do(tmp_path / "stopped", [run]) == [(1, 300, "")]
    assert outcome(tmp_path / "stopped", run) == outcome(tmp_path / "uninterrupted", run)
