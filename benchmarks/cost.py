"""Control steps per second by cores, and the hours of Figure 8, for `benchmarks/train.py --cores`.

Measured: ten seeds divided among as many processes of one thread as there are cores, side by side,
as `jbench train` divides them, evaluations included. Predicted: `seconds_per_step` of one process
with its share of the seeds, alone on a core, by the time of the processor, which other work on the
machine does not take. Both train with the settings of the row, but update more often and less at a
time, so that seconds suffice.
"""

import heapq
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from jbench.cores import ONE_THREAD
from jbench.names import SettingsBase
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.sweeps.batches import batches
from jbench.training.speed import seconds_per_step

SEEDS = 10
PAPER_STEPS = 5_000_000
FIGURE_8 = 2  # configurations
PREDICTED = (2, 8, 16)  # cores


class Agent(NamedTuple):
    """An algorithm with the settings of a source."""

    algo: str
    base: SettingsBase

    def __str__(self) -> str:
        return f"{self.algo.upper()} {self.base}"


AGENTS = [Agent("ddpg", "published"), Agent("ddpg", "figure8"), Agent("td3", "published")]


def runs_of(agent: Agent, seeds: Sequence[int]) -> list[RunSettings]:
    """Returns runs of the paper's length."""
    hyperparameters = algorithm_settings(agent.algo, agent.base).model_dump(mode="json")
    return [
        RunSettings(
            task="face_direction",
            algo=agent.algo,
            seed=seed,
            steps=PAPER_STEPS,
            evaluate_every=50_000,
            evaluate_episodes=10,
            hyperparameters=hyperparameters,
        )
        for seed in seeds
    ]


@cache
def processor_seconds(agent: Agent, seeds: int) -> float:
    """Returns the processor's seconds per control step of each run of a process with seeds."""
    (seconds,) = _measure(agent, [(seeds, _cores()[0])])
    return seconds["processor"]


def _measure(agent: Agent, processes: Sequence[tuple[int, int]]) -> list[dict[str, float]]:
    """Returns the seconds per control step of processes side by side: (seeds, core) of each."""
    started = [
        subprocess.Popen(
            [sys.executable, __file__, *agent, str(seeds), str(core)],
            stdout=subprocess.PIPE,
            text=True,
            env={
                **os.environ,
                **ONE_THREAD,
                "MUJOCO_GL": "disable",
                "PYTHONPATH": str(Path(__file__).parents[1]),
            },
        )
        for seeds, core in processes
    ]
    answers = [process.communicate()[0] for process in started]
    if any(process.returncode for process in started):
        raise SystemExit(f"A measurement of {agent} failed; see above.")
    return [json.loads(answer) for answer in answers]


def _cores() -> list[int]:
    return sorted(os.sched_getaffinity(0))


def measured_rate(agent: Agent, cores: int) -> float:
    """Returns the control steps per second of ten seeds on some cores of this machine."""
    shares = [len(batch) for batch in batches(runs_of(agent, range(SEEDS)), cores, "cpu")]
    answers = _measure(agent, list(zip(shares, _cores()[:cores], strict=True)))
    # `jbench train` ends with its slowest process.
    return SEEDS / max(answer["wall"] for answer in answers)


def predicted_rate(agent: Agent, cores: int) -> float:
    """Returns the control steps per second of ten seeds that the model predicts for some cores."""
    return SEEDS * PAPER_STEPS / predicted_seconds(agent, cores, 1)


def predicted_seconds(agent: Agent, cores: int, configurations: int) -> float:
    """Returns the seconds of configurations of ten seeds: a process starts when a core is free."""
    runs = runs_of(agent, range(SEEDS))
    busy_until = [0.0] * cores
    for batch in batches(runs, cores, "cpu") * configurations:
        length = PAPER_STEPS * processor_seconds(agent, len(batch))
        heapq.heapreplace(busy_until, busy_until[0] + length)
    return max(busy_until)


def rows(counts: Sequence[int], agents: Sequence[Agent] = AGENTS) -> None:
    """Prints the tables of rates and of hours as Markdown."""
    most = len(_cores())
    if too_many := [count for count in counts if count > most]:
        raise SystemExit(f"This process may use {most} cores, not {max(too_many)}.")

    print("| control steps/s of ten seeds | cores | measured | predicted |")
    print("|---|---|---|---|")
    for agent in agents:
        for count in counts:
            _say(f"{agent} on {count} cores")
            measured, predicted = measured_rate(agent, count), predicted_rate(agent, count)
            print(f"| {agent} | {count} | {measured:,.0f} | {predicted:,.0f} |", flush=True)

    print("\n| Figure 8, predicted hours | " + " | ".join(f"{n} cores" for n in PREDICTED) + " |")
    print("|---" * (len(PREDICTED) + 1) + "|")
    for agent in agents:
        _say(f"{agent}: processes of fewer seeds")
        hours = [predicted_seconds(agent, count, FIGURE_8) / 3600 for count in PREDICTED]
        print(f"| {agent} | " + " | ".join(f"{each:.1f}" for each in hours) + " |", flush=True)
    print(f"\nload {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def _say(what: str) -> None:
    print(f"measuring {what}", file=sys.stderr, flush=True)


def worker(algo: str, base: SettingsBase, seeds: str, core: str) -> None:
    """Prints the seconds per control step of this process, by both clocks."""
    import torch

    os.sched_setaffinity(0, {int(core)})
    torch.set_num_threads(1)
    runs = runs_of(Agent(algo, base), range(int(seeds)))
    wall = seconds_per_step(runs)
    processor = seconds_per_step(runs, clock=time.process_time)
    print(json.dumps({"wall": wall, "processor": processor}))


if __name__ == "__main__":
    worker(*sys.argv[1:])  # type: ignore[arg-type]
