"""Tests of the estimate of memory that runs will need."""

import torch

from jbench.agents.batched.pair_buffer import PairBuffer
from jbench.agents.batched.replay import Sizes
from jbench.sweeps import forecasts
from jbench.sweeps.forecasts import memory_sentence
from jbench.tasks.find import find_task
from tests.training.small_runs import small_run
from tests.training.test_gym_runs import run_of


def run(algo="ddpg", **changes):
    lengths = {"steps": 5_000_000, "evaluate_every": 50_000, "evaluate_episodes": 10}
    return small_run(algo, {}, **{"engine": "batched", **lengths, **changes})


def test_only_large_replay_buffers_are_reported():
    ten = [run(seed=seed) for seed in range(10)]
    assert memory_sentence(ten) is None
    # 7.2 GB: a million transitions of 16 + 2 numbers each.
    sentence = memory_sentence([run(seed=seed) for seed in range(100)])
    assert sentence is not None
    assert sentence.startswith("The replay buffers of 100 runs will take up to 7.2 GB of memory")
    # 72 TB exceed any memory.
    sentence = memory_sentence([run()] * 1_000_000)
    assert "72000.0 GB" in sentence
    assert "fewer --seeds at a time, or --set buffer_size=" in sentence
    assert memory_sentence([run(engine="sb3")] * 1000) is None


def test_buffer_of_episodes_that_end_early_is_as_large_as_what_is_allocated():
    task = find_task("tests.gym_tasks:leaves")
    one = run_of("td3", task=task.name, specs=task.specs, steps=5_000_000)
    one = one.model_copy(update={"hyperparameters": {"buffer_size": 1_000_000}})
    sizes = Sizes(1, 1, 1000, task.observation_size, task.action_size)
    buffer = PairBuffer(sizes, flush_every=1)
    sentence = memory_sentence([one] * 1000)
    assert f" {1000 * 1000 * buffer.seed_rows(range(1)).nbytes / 1e9:.1f} GB " in sentence


def test_advised_replay_buffer_is_small_enough(monkeypatch):
    monkeypatch.setattr(forecasts, "_available", lambda: 3_600_000_000)
    # PPO has none; the others fill 100,000 of a million transitions: 7.2 GB.
    runs = [run("ppo"), *(run(seed=seed, steps=100_000) for seed in range(1000))]
    sentence = memory_sentence(runs)
    assert sentence.endswith(
        "fewer --seeds at a time, or --set buffer_size=25000 (in a matrix file, the same key of "
        "[hyperparameters.ddpg])."
    )


def test_memory_of_gpu_is_read_from_device(monkeypatch):
    # A GPU allocates the whole buffer, also for 300,000 transitions.
    runs = [run(seed=seed, steps=300_000) for seed in range(100)]
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(
        torch.cuda, "mem_get_info", {"cuda": (9_000_000_000, 9), "cuda:1": (3_600_000_000, 9)}.get
    )
    # 7.2 GB are 80% of 9 GB.
    needs = "The replay buffers of 100 runs will take up to 7.2 GB of the GPU's memory"
    assert memory_sentence(runs, "cuda") == f"{needs}."
    advice = (
        "fewer --seeds at a time, or --set buffer_size=250000 (in a matrix file, the same key of "
        "[hyperparameters.ddpg])."
    )
    assert (
        memory_sentence(runs, "cuda:1") == f"{needs}, and 3.6 GB are free here: for less, {advice}"
    )
