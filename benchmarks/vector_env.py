"""Speed of jbench's vector environment and those of Gymnasium and stable-baselines3.

All step as many environments of one task with the same random actions, one after another for
several rounds. It also measures the processor time of a control step, including that of started
processes. On a busy machine, the rate depends on the number of processes or threads that
compete with other work, so compare those with a process or thread for each environment.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv
from stable_baselines3.common.vec_env import SubprocVecEnv

import jbench.tasks  # noqa: F401 - registers the environments
from jbench.commands import output
from jbench.cores import cores

ID = "Jitterbug/MoveToPose-v0"
WARM_UP = 3  # steps of all environments that are not counted


class Stepper(NamedTuple):
    """A vector environment to measure.

    Attributes:
        step: takes actions (environments, 1).
        processes: that it has started.
        close: ends them.
    """

    step: Callable[[Any], Any]
    processes: Sequence[BaseProcess]
    close: Callable[[], None]


def steppers(count: int) -> dict[str, Stepper]:
    """Returns the vector environments by name, reset; those that fork come first."""
    make = partial(gymnasium.make, ID, disable_env_checker=True)
    forked = AsyncVectorEnv([make] * count, context="fork")
    forked.reset(seed=0)
    sb3 = SubprocVecEnv([make] * count, start_method="fork")
    sb3.seed(0)
    sb3.reset()
    sync = gymnasium.make_vec(ID, count, "sync", disable_env_checker=True)
    sync.reset(seed=0)
    ours = gymnasium.make_vec(ID, count)
    ours.reset(seed=0)
    threads = gymnasium.make_vec(ID, count, threads=count)
    threads.reset(seed=0)
    return {
        "Gymnasium's SyncVectorEnv": Stepper(sync.step, (), sync.close),
        "Gymnasium's AsyncVectorEnv": Stepper(forked.step, forked.processes, forked.close),
        "stable-baselines3's SubprocVecEnv": Stepper(sb3.step, sb3.processes, sb3.close),
        "jbench, a thread for each core": Stepper(ours.step, (), ours.close),
        "jbench, a thread for each environment": Stepper(threads.step, (), threads.close),
    }


def processor_time(processes: Sequence[BaseProcess]) -> float:
    """Returns the processor time of this process and of others (s)."""
    ticks = 0
    for process in processes:
        with open(f"/proc/{process.pid}/stat", encoding="utf-8") as file:
            fields = file.read().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])  # utime and stime, see proc(5)
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def measure(stepper: Stepper, actions: Any, seconds: float) -> tuple[float, float]:
    """Returns control steps per second, and the processor time of a control step (us)."""
    for held in actions[:WARM_UP]:
        stepper.step(held)
    steps, began, cpu = 0, time.perf_counter(), processor_time(stepper.processes)
    while time.perf_counter() - began < seconds:
        stepper.step(actions[steps % len(actions)])
        steps += 1
    took = time.perf_counter() - began
    count = steps * actions.shape[1]
    return count / took, 1e6 * (processor_time(stepper.processes) - cpu) / count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=5, help="of all environments in turn")
    parser.add_argument("--seconds", type=float, default=2, help="of a measurement")
    arguments = parser.parse_args()
    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (1000, arguments.envs, 1)).astype(np.float32)
    measured = steppers(arguments.envs)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in measured}
    for _ in range(arguments.rounds):
        for name, stepper in measured.items():
            found[name].append(measure(stepper, actions, arguments.seconds))
    for stepper in measured.values():
        stepper.close()
    by_name = {name: np.array(rounds) for name, rounds in found.items()}
    first = next(iter(by_name.values()))
    rows = []
    for name, rounds in by_name.items():
        ratios = rounds[:, 0] / first[:, 0]
        rows.append(
            (
                name,
                f"{np.median(rounds[:, 0]):,.0f}",
                f"{np.median(ratios):.2f} [{ratios.min():.2f}, {ratios.max():.2f}]",
                f"{np.median(rounds[:, 1]):,.0f}",
            )
        )
    title = f"{arguments.envs} environments, {cores()} cores; medians of {arguments.rounds} rounds"
    header = ("", "control steps/s", "of SyncVectorEnv's", "processor time of a step (us)")
    output.table(title, header, rows)


if __name__ == "__main__":
    main()
