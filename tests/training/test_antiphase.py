"""Tests of seed groups trained in antiphase: results of a single group, and order of turns."""

import time
from itertools import groupby

import pytest
import torch

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.environments import Environments
from jbench.errors import WorkError
from jbench.policies.saved import WEIGHTS
from jbench.store import Results
from jbench.training.antiphase import number_of_groups, take_turns
from jbench.training.batched_run import run_batch
from tests.training.small_runs import EPISODE, rows
from tests.training.test_batched_run import settings

CPU = torch.device("cpu")
SLOW = pytest.mark.slow


def test_only_many_seeds_on_gpu_are_divided():
    gpu = torch.device("cuda")
    counts = {
        (device.type, seeds): number_of_groups(seeds, device)
        for device in (CPU, gpu)
        for seeds in (19, 20)
    }
    assert counts == {("cpu", 19): 1, ("cpu", 20): 1, ("cuda", 19): 1, ("cuda", 20): 2}


def test_trainings_alternate_until_all_end():
    seen = []

    def training(name, turns):
        for turn in range(turns):
            seen.append(f"{name}{turn}")
            yield
        return name

    assert take_turns([training("a", 1), training("b", 3), training("c", 2)], CPU) == [
        "a",
        "b",
        "c",
    ]
    assert seen == ["a0", "b0", "c0", "b1", "c1", "b2"]


def test_trainings_on_cpu_do_not_initialize_cuda(monkeypatch):
    def initialize(*_):
        raise AssertionError

    def training():
        yield
        return "trained"

    for name in ("stream", "Stream", "current_device"):
        monkeypatch.setattr(torch.cuda, name, initialize)
    assert take_turns([training()], CPU) == ["trained"]


def test_error_of_one_training_ends_others():
    closed = []

    def waiting():
        try:
            yield
            yield
        finally:
            closed.append(True)

    def failing():
        yield
        raise WorkError("The disk is full.")

    with pytest.raises(WorkError, match="The disk is full"):
        take_turns([waiting(), failing()], CPU)
    assert closed == [True]


@pytest.mark.usefixtures("short_episodes")
@pytest.mark.parametrize(
    "algo", ["ddpg", pytest.param("sac", marks=SLOW), pytest.param("ppo", marks=SLOW)]
)
def test_several_groups_write_same_results_as_one(algo, tmp_path):
    runs = [
        settings(algo, seed, task=task, steps=4 * EPISODE)
        for task in ("face_direction", "move_from_origin")
        for seed in (0, 3)
    ]
    one, two = Results(tmp_path / "one"), Results(tmp_path / "two")
    assert run_batch(runs, one, None, groups=1) == {}
    assert run_batch(runs, two, None, groups=2, until=2 * EPISODE) == {}
    assert [two.find("run", run.id).rows("episodes") for run in runs] == [2] * 4
    assert run_batch(runs, two, None, groups=3) == {}
    for run in runs:
        found, expected = (results.find("run", run.id) for results in (two, one))
        assert found.status == "finished"
        assert found.manifest.summary["together"] == 4
        assert rows(found) == rows(expected)
        assert found.read_file(WEIGHTS) == expected.read_file(WEIGHTS)


@pytest.mark.usefixtures("short_episodes")
def test_one_group_steps_during_updates_of_other(tmp_path, monkeypatch):
    events = []

    def record_calls(owner, method, name):
        wrapped = getattr(owner, method)

        def note(self, *args):
            result = wrapped(self, *args)
            if result is not False:
                robots = self.environments if isinstance(self, Engine) else self
                events.append((robots, name))
            return result

        monkeypatch.setattr(owner, method, note)

    record_calls(Engine, "begin_updates", "begin")
    record_calls(Engine, "_check_losses", "end")
    record_calls(Environments, "step", "step")
    assert (
        run_batch([settings("ddpg", 0), settings("ddpg", 1)], Results(tmp_path), None, groups=2)
        == {}
    )
    first = events[0][0]
    order = [("ab"[robots is not first] + " " + name) for robots, name in events]
    # 100 control steps with updates every 10 steps.
    turns = [(name, len(list(same))) for name, same in groupby(order)]
    assert turns[:8] == [
        *(("a step", 10), ("a begin", 1), ("b step", 10), ("b begin", 1)),
        *(("a end", 1), ("a step", 10), ("a begin", 1), ("b end", 1)),
    ]
    assert turns.count(("b step", 10)) == 10


@pytest.mark.usefixtures("short_episodes")
def test_processor_time_counts_only_own_turns(tmp_path):
    runs, results = [settings("ddpg", seed) for seed in (0, 1)], Results(tmp_path)
    began = time.process_time()
    run_batch(runs, results, None, groups=2)
    took = time.process_time() - began
    spent = [results.find("run", run.id).manifest.summary["processor_time"] for run in runs]
    assert min(spent) > 0
    assert sum(spent) <= took
