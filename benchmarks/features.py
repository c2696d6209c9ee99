"""Measures the cost of features learned with the agent: TD3's updates on one thread.

    python benchmarks/features.py

Published settings on face_direction; representations alternate after 10 updates. It measures
processor time, which depends less on other work on the machine.
"""

import argparse
import statistics
import time
from typing import Any

import torch

from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.make import on_features
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.td3 import TD3Learner
from jbench.agents.batched.tensors import Tensors
from jbench.settings.algorithms import TD3Settings
from jbench.settings.records import OFESettings

_SIZE = 16  # numbers in an observation
_UNITS = (12, 240)
_UPDATES = 10


def main() -> None:
    """Prints a line for each representation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7, help="of 10 updates of each")
    rounds = parser.parse_args().rounds
    torch.set_num_threads(1)
    settings = TD3Settings()
    learners: dict[str, OffPolicyLearner[Any]] = {
        "full": TD3Learner(settings, _SIZE, 1, Tensors(1).select(0))
    }
    for units in _UNITS:
        ofe, part = OFESettings(units=units), Tensors(1).select(0)
        learners[f"ofe{units}"] = on_features("td3", ofe)(settings, _SIZE, 1, part)
    rows = settings.batch_size, _SIZE + 2
    batches = {
        name: Batch(
            torch.randn(rows),
            torch.randn(rows),
            torch.full((settings.batch_size, 1), settings.gamma),
            torch.randn(settings.batch_size, 1),
        )
        for name in learners
    }
    times: dict[str, list[float]] = {name: [] for name in learners}
    for name, learner in learners.items():
        learner.initialize(torch.Generator().manual_seed(0))
        _seconds(learner, batches[name])
    for _ in range(rounds):
        for name, learner in learners.items():
            times[name].append(_seconds(learner, batches[name]))
    for name, seconds in times.items():
        ratios = [one / full for one, full in zip(seconds, times["full"], strict=True)]
        print(
            f"{name}: {1 / statistics.median(seconds):.0f} updates per second of processor time, "
            f"{statistics.median(ratios):.2f} times the time of full"
        )


def _seconds(learner: OffPolicyLearner[Any], batch: Batch) -> float:
    """Returns the processor time of an update; every other update is delayed."""
    began = time.process_time()
    for number in range(_UPDATES):
        learner.update(batch, delayed=number % 2 == 1)
    return (time.process_time() - began) / _UPDATES


if __name__ == "__main__":
    main()
