"""Tests and measures the batched engine on a GPU: `python benchmarks/gpu.py`.

In this order, within 20 minutes:

1. the tests of `tests/agents/test_gpu.py` and `test_captured_regions.py`;
2. updates per second without robots, of 10, 40 and 100 seeds in one stack;
3. whole training of 10 and 40 seeds in one stack with 1 and 8 environments each, and what takes the
   time: of whole rollouts, since TD3 and PPO make many updates at the end of one;
4. a profile of the kernels of DDPG's update.

The results are rows of Markdown, printed and written to --out. `--device cpu --small` runs all
parts on a CPU in a minute: a rehearsal, whose numbers mean nothing.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import torch
from stacked_updates import Updates, peak

from jbench.agents.batched.engine import BatchedEngine
from jbench.agents.batched.make import make_batched_engine
from jbench.agents.environments import Environments
from jbench.cores import cores
from jbench.devices import find_device
from jbench.errors import RequestError
from jbench.names import Precision
from jbench.settings.algorithms import ALGORITHMS, AlgorithmSettings, algorithm_settings
from jbench.store.provenance import device_provenance, processor
from jbench.timing import measured

ROOT = Path(__file__).parents[1]
TESTS = ("tests/agents/test_gpu.py", "tests/agents/test_captured_regions.py")
TASK = "face_direction"
Overrides = Mapping[str, Mapping[str, Any]]


_LATER: Overrides = {algo: {"learning_starts": 500} for algo in ("ddpg", "td3", "sac")}


class Size(NamedTuple):
    """How much is measured.

    Attributes:
        seeds: numbers of seeds in a stack.
        transitions: in a replay buffer.
        updates: in a measurement of the rate of updates.
        rounds: measurements, of which the median is reported.
        product: rows and columns of the matrices whose product is the peak.
        trained: numbers of seeds of whole training.
        environments: numbers of robots of each of them.
        warm_up: control steps of each seed before whole training is measured.
        seconds: of whole training, at least.
        tests: arguments of pytest.
        overrides: changed settings of each algorithm.
    """

    seeds: tuple[int, ...] = (10, 40, 100)
    transitions: int = 20_000
    updates: int = 200
    rounds: int = 5
    product: int = 8192
    trained: tuple[int, ...] = (10, 40)
    environments: tuple[int, ...] = (1, 8)
    warm_up: int = 3000
    seconds: float = 10.0
    tests: tuple[str, ...] = ()
    overrides: Overrides = _LATER


_TINY = {"hidden_layers": [32, 16], "batch_size": 16}
SMALL = Size(
    seeds=(2,),
    transitions=400,
    updates=4,
    rounds=2,
    product=64,
    trained=(2,),
    warm_up=80,
    seconds=0.3,
    tests=("-k", "saved_policies and ddpg"),
    overrides={
        "ddpg": {**_TINY, "learning_starts": 50, "train_freq": 40, "gradient_steps": 5},
        "td3": {**_TINY, "learning_starts": 50, "train_freq": 40, "gradient_steps": 5},
        "sac": {**_TINY, "learning_starts": 50},
        "ppo": {**_TINY, "n_steps": 16},
    },
)


class Report:
    """Markdown that is printed and at once written to a file."""

    def __init__(self, path: Path) -> None:
        self._path, self._lines = path, list[str]()

    def line(self, text: str = "") -> None:
        """Adds a line."""
        print(text, flush=True)
        self._lines.append(text)
        self._path.write_text("\n".join(self._lines) + "\n", encoding="utf-8")

    def row(self, *cells: object) -> None:
        """Adds a row of a table."""
        self.line(f"| {' | '.join(map(str, cells))} |")

    def table(self, *columns: str) -> None:
        """Starts a table."""
        self.line()
        self.row(*columns)
        self.row(*["---"] * len(columns))


def settings_for(algo: str, size: Size) -> AlgorithmSettings:
    """Returns the settings of an algorithm."""
    overrides = dict(size.overrides.get(algo, {}))
    if algo != "ppo":
        overrides["buffer_size"] = size.transitions
    return algorithm_settings(algo, overrides=overrides)


def untrained_engine(
    algo: str,
    size: Size,
    seeds: int,
    device: torch.device,
    precision: Precision = "float32",
    environments: int | None = None,
) -> BatchedEngine[Any]:
    """Returns untrained agents in one stack."""
    settings = settings_for(algo, size)
    count = environments or int(getattr(settings, "n_envs", 1))
    threads = cores() if device.type == "cuda" else 1
    robots = Environments(TASK, range(seeds), count, threads=threads)
    return make_batched_engine(
        algo, settings, robots, device=device, precision=precision, stacked=True
    )


def report_tests(size: Size, report: Report) -> bool:
    """Runs the tests and reports their last line; returns whether they passed."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", *TESTS, *size.tests]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        report.line(f"```\n{done.stdout}\n```\n")
    *_, last = done.stdout.strip().splitlines() or ["nothing"]
    report.line(f"Tests: {last}")
    return done.returncode == 0


def available_precisions(algo: str, device: torch.device) -> list[Precision]:
    """Returns the precisions that an algorithm has on a device."""
    found: list[Precision] = ["float32"]
    if device.type == "cuda":
        found.append("tf32")
    if algo != "ppo":
        found.append("bfloat16")
    return found


def report_updates(size: Size, device: torch.device, report: Report) -> None:
    """Reports updates per second without robots."""
    peaks = {
        name: peak(name, size.product, device) for name in available_precisions("ddpg", device)
    }
    rates = ", ".join(f"{name} {rate / 1e12:,.1f} TFLOP/s" for name, rate in peaks.items())
    report.line(f"\nPeak, one product of {size.product} x {size.product} matrices: {rates}.")
    report.table(
        *("algorithm", "seeds", "precision", "updates/s of all seeds", "with drawing minibatches"),
        *("µs per update of the stack", "kernels per update", "time in kernels"),
        *("TFLOP/s of the products", "of the peak"),
    )
    for algo, seeds in product(ALGORITHMS, size.seeds):
        for precision in available_precisions(algo, device):
            with untrained_engine(algo, size, seeds, device, precision=precision) as engine:
                updates = Updates(engine, size.transitions)
                cells = _rates(updates, size, seeds, peaks[precision])
            report.row(algo, seeds, precision, *cells)


def _rates(updates: Updates, size: Size, seeds: int, most: float) -> list[str]:
    for _ in range(3):  # calls, records and replays
        updates.make(size.updates)
    rounds = [updates.make(size.updates) for _ in range(size.rounds)]
    rate = median(count / seconds for count, seconds, _ in rounds)
    with_drawing = median(count / seconds for count, _, seconds in rounds)
    count, kernels = updates.kernels(min(size.updates, 50))
    in_kernels = sum(seconds for _, seconds in kernels.values()) / count
    flops = updates.flops() * rate
    return [
        f"{seeds * rate:,.0f}",
        f"{seeds * with_drawing:,.0f}",
        f"{1e6 / rate:,.0f}",
        f"{sum(times for times, _ in kernels.values()) / count:.0f}",
        f"{in_kernels * rate:.0%}",
        f"{flops / 1e12:.2f}",
        f"{flops / most:.1%}",
    ]


def report_training(size: Size, device: torch.device, report: Report) -> None:
    """Reports control steps per second of whole training, and what takes the time."""
    report.table("algorithm", "seeds", "environments", "control steps/s of all seeds", "time in")
    for algo, seeds, environments in product(ALGORITHMS, size.trained, size.environments):
        with untrained_engine(algo, size, seeds, device, environments=environments) as engine:
            steps = engine.learn(10**12)
            rollout = settings_for(algo, size).rollout(environments)
            while engine.control_steps < size.warm_up or engine.control_steps % rollout:
                next(steps)
            first = engine.control_steps
            with measured() as seconds:
                began = time.perf_counter()
                end = began + size.seconds
                while time.perf_counter() < end or engine.control_steps % rollout:
                    next(steps)
                took = time.perf_counter() - began
            rate = seeds * (engine.control_steps - first) / took
        parts = ", ".join(f"{name} {spent / took:.0%}" for name, spent in seconds.items())
        report.row(algo, seeds, environments, f"{rate:,.0f}", parts)


def report_profile(size: Size, device: torch.device, report: Report) -> None:
    """Reports the kernels of DDPG's update that take the most time."""
    with untrained_engine("ddpg", size, size.seeds[0], device) as engine:
        updates = Updates(engine, size.transitions)
        for _ in range(3):
            updates.make(size.updates)
        count, kernels = updates.kernels(min(size.updates, 50))
    total = sum(seconds for _, seconds in kernels.values())
    report.table(f"kernel of DDPG's update, {size.seeds[0]} seeds", "per update", "µs", "share")
    for name, (times, seconds) in sorted(kernels.items(), key=lambda item: -item[1][1])[:15]:
        share = f"{seconds / total:.0%}"
        report.row(f"`{name[:90]}`", f"{times / count:.1f}", f"{1e6 * seconds / count:.1f}", share)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cuda", help="cuda, cuda:1 or, for a rehearsal, cpu")
    parser.add_argument("--small", action="store_true", help="rehearse with tiny numbers")
    parser.add_argument("--out", type=Path, default=Path("gpu.md"), help="file of the rows")
    arguments = parser.parse_args()
    try:
        device = find_device(arguments.device)
    except RequestError as error:
        parser.error(str(error))
    torch.set_num_threads(1)
    size, report, began = SMALL if arguments.small else Size(), Report(arguments.out), time.time()
    facts = {**device_provenance(device), "torch": torch.__version__}
    report.line(", ".join(f"{name} {value}" for name, value in facts.items()))
    report.line(f"{cores()} cores of {processor()}, {datetime.now(UTC):%Y-%m-%d}")
    passed = report_tests(size, report)
    for part in (report_updates, report_training, report_profile):
        part(size, device, report)
    report.line(f"\n{(time.time() - began) / 60:.1f} minutes.")
    if not passed:
        sys.exit("Tests failed: their output is above.")


if __name__ == "__main__":
    main()
