"""Tests of processor-time accounting: shared by seeds of a process, continued on resume."""

import itertools
import shutil
from pathlib import Path

import pytest

from jbench.store import Results, query
from jbench.store.verify import verify
from jbench.training import log
from jbench.training.checkpoints import load
from tests.training.test_checkpoints import do, only, stop_at
from tests.training.test_resume import settings

pytestmark = pytest.mark.usefixtures("short_episodes")

VERSION_2 = Path(__file__).parent / "version2"


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """Replaces the process clock by one that advances by 6 s per reading."""
    readings = itertools.count(step=6.0)
    monkeypatch.setattr(log.time, "process_time", lambda: next(readings))


def times(record):
    """Processor times of the episodes and evaluations of a run."""
    return [
        record.read(table)["processor_time"].to_pylist() for table in ("episodes", "evaluations")
    ]


@pytest.mark.parametrize("seeds", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_seeds_share_processor_time_evenly(seeds, tmp_path):
    runs = [settings("ppo", seed, steps=200, evaluate_every=100) for seed in range(seeds)]
    do(tmp_path, runs, checkpoint_every=1000, final_episodes=None)
    share = 6 / seeds
    for run in runs:
        record = only(tmp_path, run)
        # Two environments each end an episode at 100 and at 200 steps, followed by evaluations; the
        # first ones are committed at once. The last evaluation is at 240, the end of a rollout, and
        # has half as many episodes as the training.
        assert times(record) == [
            [share, share, 4 * share, 4 * share],
            [2 * share, 5 * share, 6 * share, 6 * share],
        ]
        assert record.manifest.summary["processor_time"] == 7 * share
    rows = query.query_results(Results(tmp_path), "SELECT DISTINCT processor_time FROM runs").rows
    assert rows["processor_time"].tolist() == [7 * share]


def test_resumed_run_continues_processor_time_of_checkpoint(tmp_path):
    run = settings("td3", 1, steps=200, evaluate_episodes=0)
    stop_at(tmp_path, [run], 100)
    checkpoint, _ = load(only(tmp_path, run))
    before = checkpoint.position.processor_time
    assert (checkpoint.position.control_steps, before) == (100, 24.0)
    do(tmp_path, [run])
    assert times(only(tmp_path, run))[0] == [6.0, 18.0, before + 6, before + 24]


def test_run_of_version_2_resumes_without_processor_time(tmp_path):
    shutil.copytree(VERSION_2, tmp_path / "old")
    run = settings("td3", 1, steps=200, evaluate_every=50)
    kept = only(tmp_path / "old", run).read("episodes")
    ((seed, steps, _),) = do(tmp_path / "old", [run], final_episodes=None)
    assert (seed, steps) == (1, 100)
    record = only(tmp_path / "old", run)
    assert (record.status, record.manifest.schema_version) == ("finished", 2)
    rows = record.read("episodes")
    assert rows["control_steps"].to_pylist() == [50, 100, 150, 200]
    assert rows.slice(0, 2).equals(kept)
    # Version 2 kept no paths; of the first evaluation there is none, of the last one there is.
    assert set(record.read("paths")["evaluation"].to_pylist()) == {4}
    # The fifth evaluation is at 210, the end of a rollout.
    # It has as many episodes as the training.
    assert times(record) == [[None] * 4, [None] * (4 + 4)]
    assert verify(Results(tmp_path / "old"), 1).faults == []
