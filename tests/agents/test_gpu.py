"""Tests of the engine on a GPU, with all seeds in one stack and replayed CUDA graphs.

Each test also runs on a CPU with the seeds in one stack, without graphs. `python benchmarks/gpu.py`
runs this file before it measures.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.settings.algorithms import ALGORITHMS
from jbench.store import Results
from jbench.training import batched_run
from jbench.training.events import EpisodeEnded
from tests.agents.killed_run import stack_seeds
from tests.agents.test_batched_engine import (
    CHEETAH,
    FEW,
    MANY,
    SCRIPTS,
    TanhEncoder,
    assert_continues,
    assert_policies_equal_agents,
    assert_same,
    build_engine,
    resume,
    slow,
    stopped_at,
    trajectory,
)
from tests.short_episodes import shorten_episodes
from tests.training.small_runs import resumed
from tests.training.test_resume import outcome, settings

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
GPU = pytest.param("cuda", marks=needs_gpu)
on_each_device = pytest.mark.parametrize("device", ["cpu", GPU])
slow_on_a_cpu = pytest.mark.parametrize("device", [slow("cpu"), GPU])
ROOT = Path(__file__).parents[2]

EXACT = torch.float64, 1e-9
# PPO makes one update of all transitions after each rollout.
ONE_UPDATE = {"n_epochs": 1, "batch_size": 30}


def filled_engine(algo, seeds, **options):
    """Agents whose buffers are full of reproducible random transitions."""
    engine = build_engine(algo, seeds, **options)
    random = torch.Generator().manual_seed(1)
    if isinstance(engine, OffPolicyEngine):
        width = engine.environments.size + engine.environments.action_size + 1
        for index in range(len(seeds)):
            rows = torch.randn(1, 50, width, generator=random)
            engine.replay.restore(index, rows, 50)
    else:
        rows = engine._rollout.rows
        rows.copy_(torch.randn(rows.shape, generator=random))
    return engine


def update(engine, first, count):
    """Makes some updates of all agents."""
    if isinstance(engine, OffPolicyEngine):
        for updates in engine.group_updates:
            updates.prepare(first, count)
            updates.run()
    else:
        for epochs in engine.group_updates * count:
            epochs.run()


def largest_difference(one, other):
    """The largest difference of the agents' tensors: parameters, targets, moments and losses."""
    mine, their = (engine.tensors.saved for engine in (one, other))
    assert mine.keys() == their.keys()
    return max(float((mine[name].cpu() - their[name].cpu()).abs().max()) for name in mine)


@on_each_device
@pytest.mark.parametrize(
    ("algo", "options", "dtype", "bound"),
    [
        *((algo, {"changes": ONE_UPDATE if algo == "ppo" else {}}, *EXACT) for algo in ALGORITHMS),
        ("td3", {}, torch.float32, 1e-3),
        *(slow(algo, {}, torch.float32, 1e-3) for algo in ("ddpg", "sac")),
        slow("ppo", {"changes": ONE_UPDATE}, torch.float32, 1e-3),
        ("td3", CHEETAH, *EXACT),
        *(slow(algo, CHEETAH, *EXACT) for algo in ("ddpg", "sac")),
        slow("ppo", {"changes": ONE_UPDATE, **CHEETAH}, *EXACT),
        ("ddpg", SCRIPTS["ddpg"], *EXACT),
        ("ppo", {"changes": SCRIPTS["ppo"]["changes"] | ONE_UPDATE}, *EXACT),
        ("td3", {"time_limit": "terminal"}, *EXACT),
        ("td3", {"encoder": TanhEncoder()}, *EXACT),
        ("ddpg", {"changes": {"normalize": "running"}}, *EXACT),
        ("td3", {"ofe": MANY}, *EXACT),
        ("sac", {"ofe": FEW}, *EXACT),
        # The products of both devices are rounded to bfloat16.
        ("sac", {"precision": "bfloat16"}, torch.float32, 5e-2),
    ],
)
def test_stacked_updates_equal_those_of_single_seeds_on_cpu(algo, options, dtype, bound, device):
    seeds, more = [0, 1, 2], {**options, "dtype": dtype}
    with (
        filled_engine(algo, seeds, stacked=False, device="cpu", **more) as each,
        filled_engine(algo, seeds, stacked=True, device=device, **more) as stack,
    ):
        done = 0
        for total in (1, 10, 30):
            for engine in (each, stack):
                update(engine, done + 1, total - done)
            done = total
            assert largest_difference(stack, each) < bound


@needs_gpu
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_replayed_graphs_equal_direct_calls_bit_for_bit(algo, monkeypatch):
    with build_engine(algo, [0, 4], device="cuda") as engine:
        replayed = trajectory(engine, 1)
    monkeypatch.setattr(Captured, "__call__", lambda self, function, argument: function(argument))
    with build_engine(algo, [0, 4], device="cuda") as engine:
        assert_same(trajectory(engine, 1), replayed)


@slow_on_a_cpu
@pytest.mark.parametrize(
    ("algo", "options", "steps"),
    [
        ("ddpg", {}, 40),
        ("td3", {"precision": "bfloat16"}, 43),
        ("ddpg", {"changes": {"normalize": "running"}}, 40),
        ("sac", {"ofe": FEW}, 45),
        ("ppo", {}, 60),
    ],
)
def test_restored_engine_continues_bit_for_bit(algo, options, steps, device):
    more = {**options, "device": device, "stacked": True}
    assert_continues(lambda seeds: build_engine(algo, seeds, **more), steps)


@pytest.mark.parametrize(
    ("algo", "device"),
    [
        ("td3", "cpu"),
        *(slow(algo, "cpu") for algo in ("ddpg", "sac", "ppo")),
        *(pytest.param(algo, "cuda", marks=needs_gpu) for algo in ALGORITHMS),
    ],
)
def test_checkpoint_can_be_restored_on_other_device(algo, device):
    here = {"device": "cpu", "stacked": False}
    there = {"device": device, "stacked": True}
    for first, second in ((here, there), (there, here)):
        with build_engine(algo, [0, 4], **first) as engine:
            saved = stopped_at(engine, 40)
            whole = trajectory(engine, 1)
        states = [dict(state.tensors) for state in saved[0]]
        for state in saved[0]:
            # Checkpoints of older versions on a GPU have these extra tensors.
            state.tensors["loop/actor"] = torch.full((3,), np.nan)
            state.tensors["loop/losses"] = torch.full((2, 2), np.nan)
        with build_engine(algo, [8, 9], **second) as other:
            resume(other, *saved)
            for index, tensors in enumerate(states):
                found = other.state(index)
                assert found.scalars == saved[0][index].scalars
                assert found.tensors.keys() == tensors.keys()
                for name, tensor in tensors.items():
                    assert torch.equal(found.tensors[name], tensor), name
            rest = trajectory(other, 1)
        expected = whole[0][-len(rest[0]) :]
        torch.testing.assert_close(rest[0], expected, rtol=1e-3, atol=1e-3)


@on_each_device
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_actions_equal_those_of_saved_policies(algo, device):
    # Products in TF32 would differ by 1e-3.
    with build_engine(algo, [0, 1, 2], device=device, stacked=True) as engine:
        for _ in engine.learn(32):
            pass
        # The first call is not replayed, the second records, the third replays.
        for _ in range(3):
            assert_policies_equal_agents(engine)


@slow_on_a_cpu
def test_killed_run_resumes_bit_for_bit(device, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    stack_seeds(monkeypatch.setattr)
    run = settings("td3", 1)
    asked = {"path": str(tmp_path / "killed"), "run": run.model_dump(mode="json"), "after": 200}
    command = [sys.executable, "-m", "tests.agents.killed_run"]
    done = subprocess.run([*command, json.dumps({**asked, "device": device})], cwd=ROOT)
    assert done.returncode == -signal.SIGKILL
    events = []
    for name in ("whole", "killed"):
        results = Results(tmp_path / name)
        assert batched_run.run_batch([run], results, device=device, report=events.append) == {}
    assert resumed(events, [run]) == [(1, 200, "")]
    assert outcome(tmp_path / "killed", run) == outcome(tmp_path / "whole", run)


@slow_on_a_cpu
def test_run_resumes_on_other_device_and_back(device, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run, events = settings("sac", 1), []

    def train(device, until):
        def stop(event):
            events.append(event)
            if isinstance(event, EpisodeEnded) and event.control_steps > until:
                raise KeyboardInterrupt

        options = {"device": device, "checkpoint_every": 0, "report": stop}
        batched_run.run_batch([run], Results(tmp_path), **options)

    with pytest.raises(KeyboardInterrupt):
        train("cpu", 100)
    with monkeypatch.context() as patch:
        stack_seeds(patch.setattr)
        with pytest.raises(KeyboardInterrupt):
            train(device, 250)
    train("cpu", 1000)
    (_, *first), (_, *second) = resumed(events, [run])
    assert (first[0], second[0]) == (100, 250)
    changed = f"Since it began, device cpu is now {device}" if device != "cpu" else ""
    assert first[1].startswith(changed)
    found, *_ = outcome(tmp_path, run)
    assert max(row["control_steps"] for row in found) == 400
