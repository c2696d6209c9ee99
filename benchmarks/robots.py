"""Measures what a control step of robots takes: `python benchmarks/robots.py`.

Physics is MuJoCo's, in one thread. Around it are a task's observations, rewards and the inputs of
agents, in Python and numpy. They take longer after physics, which evicts them from the processor's
caches, than without it. All are the least of many short measurements, which other work on the
machine does not lengthen.
"""

import argparse
import time
from contextlib import closing

import mujoco.batch
import numpy as np
import torch

from jbench.agents.environments import Environments
from jbench.names import TASKS

STEPS = 5
"""Control steps of a measurement."""


class Physics:
    """Times the physics steps of all robots, in s, or leaves them out."""

    def __init__(self) -> None:
        """Times those from now on."""
        self.spent = 0.0
        self.is_left_out = False
        step = mujoco.batch.Batch.step

        def timed(*arguments: object, **options: object) -> None:
            if self.is_left_out:
                return
            began = time.perf_counter()
            step(*arguments, **options)
            self.spent += time.perf_counter() - began

        mujoco.batch.Batch.step = timed


def measured(environments: Environments, rounds: int, physics: Physics) -> tuple[float, float]:
    """Returns us of a control step around the physics, and in it."""
    around = []
    inside = []
    shape = rounds, *environments.observations.shape[:2], 1
    for chosen in np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32):
        physics.spent = 0.0
        began = time.perf_counter()
        for _ in range(STEPS):
            environments.step(chosen)
        whole = time.perf_counter() - began
        around.append(1e6 * (whole - physics.spent) / STEPS)
        inside.append(1e6 * physics.spent / STEPS)

    return min(around), min(inside)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=100)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    physics = Physics()
    print(
        f"| us of a control step of {arguments.robots} robots | around the physics "
        "| around, without physics | physics |"
    )
    print("|---|---|---|---|")
    for task in TASKS:
        with closing(Environments(task, range(arguments.robots))) as environments:
            physics.is_left_out = False
            around, inside = measured(environments, arguments.rounds, physics)
            physics.is_left_out = True
            alone, _ = measured(environments, arguments.rounds, physics)
        print(f"| {task} | {around:.0f} | {alone:.0f} | {inside:.0f} |", flush=True)


if __name__ == "__main__":
    main()
