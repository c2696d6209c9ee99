"""Measures collection and closed-loop stepping against the physics: `python benchmarks/collect.py`.

The baseline is a bare loop of `mujoco.mj_step(model, data, nstep=50)` with random controls, on the
same number of threads and the model of the XML. Each round measures, one after the other: the same
loop with jbench's model, which states the pairs of parts that can touch; `jbench.datasets.collect`
with all its work (features, targets, compression, writing to disk); `Robots` of jbench in a closed
loop of observation, policy, step and reward; and a plain single-threaded dm_control loop.
Each is compared with the baselines before and after it. A ratio is the median over the rounds
[lowest, highest], so that other work on the machine affects single rounds only. The processor time
per step shows the overhead on a busy machine.

`--memory 50000 1000000` prints the peak resident memory of collections of these lengths instead.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from dm_control import suite
from numpy.typing import NDArray

import jbench.tasks  # noqa: F401 - adds the domain to the suite
from jbench.commands import output
from jbench.datasets import collect
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from jbench.task_specs import EPISODE_STEPS, PHYSICS_STEPS
from jbench.tasks.jitterbug import features, geometry, model, resets, rewards
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots

TASK = "move_from_origin"
BARE_EPISODES = 8  # on each thread, in one measurement
CLOSED_STEPS = 16_384  # control steps of all robots, in one measurement
WARM_UP = 50  # control steps that are not counted: falling robots take longer
DM_CONTROL_STEPS = 2_000


def bare(threads: int, seed: int, robot: mujoco.MjModel) -> Callable[[], int]:
    """Returns the bare loop with its random numbers drawn; it returns its control steps."""
    random = np.random.default_rng(seed)
    actions = random.uniform(-1, 1, (threads, BARE_EPISODES, EPISODE_STEPS)).tolist()
    quaternions = [[resets.draw_quaternion(random) for _ in each] for each in actions]
    datas = [mujoco.MjData(robot) for _ in range(threads)]

    def run(thread: int) -> None:
        data = datas[thread]
        for quaternion, commands in zip(quaternions[thread], actions[thread], strict=True):
            model.place(data, quaternion)
            for command in commands:
                data.ctrl[0] = command
                mujoco.mj_step(robot, data, nstep=PHYSICS_STEPS)

    def measured() -> int:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, range(threads)))
        return threads * BARE_EPISODES * EPISODE_STEPS

    return measured


def collection(threads: int, steps: int, seed: int, path: Path) -> Callable[[], int]:
    """Returns a complete collection."""

    def measured() -> int:
        collect(DatasetSettings(seed=seed, steps=steps), Results(path), threads)
        return steps

    return measured


class ClosedLoop:
    """Robots whose actions depend on the observations and are distributed like random ones."""

    def __init__(self, count: int, threads: int) -> None:
        """Makes the robots and simulates their fall to the floor."""
        random = np.random.default_rng(count)
        self.robots = Robots(load_model(), count, threads)
        self.target = geometry.Target(np.zeros((count, 3)), np.zeros(count))
        self.weights = 1e3 * random.standard_normal(features.observation_size(TASK))
        self.state = self.robots.reset(
            np.stack([resets.draw_quaternion(random) for _ in range(count)])
        )
        self.run(WARM_UP)

    def run(self, steps: int) -> None:
        """Steps all robots."""
        for _ in range(steps):
            observed = features.observation(TASK, self.state, self.target)
            self.state = self.robots.step(2 * (observed @ self.weights % 1) - 1)
            rewards.reward(TASK, self.state, self.target)

    def __call__(self) -> int:
        """Returns the number of control steps over all robots."""
        count = len(self.target.yaw)
        self.run(CLOSED_STEPS // count)
        return CLOSED_STEPS // count * count


def dm_control_loop() -> Callable[[], int]:
    """Returns a plain single-threaded dm_control loop with random actions."""
    env = suite.load("jitterbug", TASK, task_kwargs={"random": 0})
    random = np.random.default_rng(0)

    def measured() -> int:
        timestep = env.reset()
        for action in random.uniform(-1, 1, (DM_CONTROL_STEPS, 1)):
            timestep = env.reset() if timestep.last() else env.step(action)
        return DM_CONTROL_STEPS

    return measured


class Measured(NamedTuple):
    """Speed of some work.

    Attributes:
        rate: control steps per second.
        cpu: seconds of processor time per control step, over all threads.
    """

    rate: float
    cpu: float


def measure(work: Callable[[], int]) -> Measured:
    """Measures some work, which returns its number of control steps."""
    began, cpu = time.perf_counter(), time.process_time()
    steps = work()
    return Measured(steps / (time.perf_counter() - began), (time.process_time() - cpu) / steps)


def measure_all(
    threads: int, rounds: int, steps: int, counts: list[int]
) -> dict[str, NDArray[np.float64]]:
    """Returns (rounds, 3) by name: rate, and ratios of rate and CPU time to the baseline."""
    general, ours = mujoco.MjModel.from_xml_string(model.xml()), load_model()
    closed = {f"closed loop, {count} robots": ClosedLoop(count, threads) for count in counts}
    plain = {"plain dm_control loop": dm_control_loop()}
    found: dict[str, list[tuple[float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds):
            before = measure(bare(threads, number, general))
            work = {
                "bare loop": bare(threads, number, ours),
                "collect": collection(threads, steps, number, Path(folder)),
            }
            for name, loop in (work | closed | plain).items():
                measured, after = measure(loop), measure(bare(threads, number, general))
                around = Measured(*np.mean([before, after], axis=0))
                compared = (
                    measured.rate,
                    measured.rate / around.rate,
                    measured.cpu / around.cpu,
                )
                found.setdefault("bare loop of the XML", []).append((around.rate, 1, 1))
                found.setdefault(name, []).append(compared)
                before = after
            print(f"round {number + 1} of {rounds} is done", file=sys.stderr, flush=True)
    return {name: np.array(rows) for name, rows in found.items()}


def show(found: dict[str, NDArray[np.float64]], threads: int) -> None:
    """Prints the table."""
    plain = np.median(found["plain dm_control loop"][:, 0])
    rows = []
    for name, rounds in found.items():
        steps, ratio, cpu = np.median(rounds, axis=0)
        rows.append(
            (
                name,
                f"{steps:,.0f}",
                f"{PHYSICS_STEPS * steps:,.0f}",
                f"{ratio:.3f} [{rounds[:, 1].min():.3f}, {rounds[:, 1].max():.3f}]",
                f"{cpu:.3f}",
                f"{steps / plain:.2f}",
            )
        )
    rates = ("control steps/s", "physics steps/s")
    ratios = ("rate / baseline", "CPU per step / baseline", "rate / plain dm_control")
    output.table(f"{threads} threads; medians of rounds", ("", *rates, *ratios), rows)


def peak_memory(steps: int, threads: int) -> tuple[float, float]:
    """Returns the peak resident memory (MB) and the seconds of a collection in its own process."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["collect", "--steps", str(steps), "--threads", str(threads)]
        began = time.perf_counter()
        process = subprocess.Popen([sys.executable, "-m", "jbench", *command, "--results", folder])
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"jbench {' '.join(command)} ended with {process.returncode}")
        return usage.ru_maxrss * 1024 / 1e6, time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=50_000, help="control steps of a collection")
    parser.add_argument("--robots", type=int, nargs="*", default=[8, 64, 256])
    parser.add_argument("--memory", type=int, nargs="*", help="lengths of collections")
    arguments = parser.parse_args()
    if arguments.memory is None:
        found = measure_all(arguments.threads, arguments.rounds, arguments.steps, arguments.robots)
        show(found, arguments.threads)
        return
    for steps in arguments.memory:
        megabytes, seconds = peak_memory(steps, arguments.threads)
        print(f"{steps:,} control steps: at most {megabytes:.0f} MB, {seconds:.0f} s")


if __name__ == "__main__":
    main()
