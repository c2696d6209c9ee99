"""Measures what a control step of robots takes: `python benchmarks/robots.py`.

Physics is MuJoCo's, in one thread. Around it are a task's observations, rewards and the inputs of
agents, in Python and numpy. Both are the least of many short measurements, which other work on the
machine does not lengthen.
"""

import argparse
import time
from collections.abc import Iterator
from contextlib import closing

import mujoco.batch
import numpy as np
import torch

from jbench.agents.environments import Environments
from jbench.names import TASKS

STEPS = 5
"""Control steps of a measurement."""


class Physics:
    """Times the physics steps of all robots, in s."""

    def __init__(self) -> None:
        """Times those from now on."""
        self.spent = 0.0
        step = mujoco.batch.Batch.step

        def timed(*arguments: object, **options: object) -> None:
            began = time.perf_counter()
            step(*arguments, **options)
            self.spent += time.perf_counter() - began

        mujoco.batch.Batch.step = timed


def measured(
    task: str, robots: int, rounds: int, physics: Physics
) -> Iterator[tuple[float, float]]:
    """Yields us of a control step around the physics, and in it, for each measurement."""
    actions = np.random.default_rng(0).uniform(-1, 1, (rounds, robots, 1, 1)).astype(np.float32)
    with closing(Environments(task, range(robots))) as environments:
        for chosen in actions:
            physics.spent, began = 0.0, time.perf_counter()
            for _ in range(STEPS):
                environments.step(chosen)
            whole = time.perf_counter() - began
            around = whole - physics.spent
            yield 1e6 * around / STEPS, 1e6 * physics.spent / STEPS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=100)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    physics = Physics()
    print(f"| us of a control step of {arguments.robots} robots | around the physics | physics |")
    print("|---|---|---|")
    for task in TASKS:
        each = measured(task, arguments.robots, arguments.rounds, physics)
        around, inside = (min(values) for values in zip(*each, strict=True))
        print(f"| {task} | {around:.0f} | {inside:.0f} |", flush=True)


if __name__ == "__main__":
    main()
