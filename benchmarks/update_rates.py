"""Measures updates without the robots, and the parts of whole training.

`benchmarks/train.py` prints these rows.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from itertools import product
from statistics import median
from typing import Any

import torch
from torch import Tensor

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.make import make_engine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.names import ALGORITHMS
from jbench.settings.algorithms import algorithm_settings

BATCH, OBSERVATION, HIDDEN = 256, 16, (350, 250)
TRANSITIONS = 100_000
BURST = 50  # updates at a time, as DDPG makes them
BURSTS = 30
SEEDS = 10
WARM_UP = 3000  # control steps of each seed before whole training is measured


def engine_with_transitions(seeds: int, algo: str = "ddpg", **options: Any) -> OffPolicyEngine:
    """Returns agents whose replay buffers are full of random numbers."""
    settings = algorithm_settings(algo, overrides={"buffer_size": TRANSITIONS})
    engine = make_engine(algo, settings, "face_direction", range(seeds), **options)
    assert isinstance(engine, OffPolicyEngine)
    rows = torch.randn(1, TRANSITIONS, OBSERVATION + 2)
    for seed in range(seeds):
        engine.restore_rows(seed, rows, TRANSITIONS)
    return engine


def products() -> Callable[[], None]:
    """Returns a function that computes only the matrix products of a DDPG update."""

    def matrix(*shape: int) -> Tensor:
        return torch.randn(*shape)

    first, second = HIDDEN
    units, more, outputs = matrix(BATCH, first), matrix(BATCH, second), matrix(BATCH, 1)
    weights, last = matrix(first, second), matrix(second, 1)
    by_weights, by_last = matrix(first, second), matrix(second, 1)
    inputs = {size: matrix(BATCH, size) for size in (OBSERVATION, OBSERVATION + 1)}
    starts = {size: matrix(size, first) for size in inputs}

    def forward(size: int) -> None:
        torch.mm(inputs[size], starts[size], out=units)
        torch.mm(units, weights, out=more)
        torch.mm(more, last, out=outputs)

    def backward() -> None:
        torch.mm(outputs, last.mT, out=more)
        torch.mm(more, weights.mT, out=units)

    def by_parameters(size: int) -> None:
        torch.mm(more.mT, outputs, out=by_last)
        torch.mm(units.mT, more, out=by_weights)
        torch.mm(inputs[size].mT, units, out=starts[size])

    policy, value = inputs

    def run() -> None:
        # Both targets; the critic and its gradient; the actor's loss and its gradient.
        for size in (policy, value, value):
            forward(size)
        backward()
        by_parameters(value)
        for size in (policy, value):
            forward(size)
        backward()
        torch.mm(units, starts[value][-1:].mT)
        backward()
        by_parameters(policy)

    return run


def fraction_of_products(seeds: int, **options: Any) -> tuple[float, float, float]:
    """Returns the seconds of an update, those of its products alone, and their ratio.

    Both alternate, in processor time of this thread, which depends little on other processes.
    """
    engine, alone = engine_with_transitions(seeds, device="cpu", **options), products()
    times: list[tuple[float, float]] = []
    for burst in range(BURSTS // seeds + 2):
        for group in engine._groups:
            group.prepare(1 + burst * BURST, BURST)
            began = time.thread_time()
            group.run()
            update = time.thread_time() - began
            began = time.thread_time()
            for _ in range(BURST):
                alone()
            times.append((update / BURST, (time.thread_time() - began) / BURST))
    times = times[seeds:]
    return (
        median(update for update, _ in times),
        median(its for _, its in times),
        median(its / update for update, its in times),
    )


def cpu_rows() -> None:
    """Prints the rows of one core while a second process keeps the other core busy."""
    torch.set_num_threads(1)
    with subprocess.Popen([sys.executable, __file__], stdout=subprocess.DEVNULL) as other:
        for name, options in (("float32", {}), ("bfloat16", {"precision": "bfloat16"})):
            update, alone, part = fraction_of_products(5, **options)
            print(
                f"DDPG's update in {name}: {update * 1e3:.2f} ms per core, its products alone in "
                f"float32 {alone * 1e3:.2f} ms: {part:.2f} of the rate of products",
                flush=True,
            )
        other.kill()


def cuda_rows(device: str = "cuda", seconds: float = 15.0) -> None:
    """Prints the rows of a GPU, or those of a stack on the CPU."""
    options: dict[str, Any] = {"device": device, "stacked": True}
    precisions = ("float32", "tf32", "bfloat16") if device == "cuda" else ("float32",)
    for algo, seeds, precision in product(("ddpg", "td3", "sac"), (10, 40), precisions):
        rate = _updates_a_second(algo, seeds, precision=precision, **options)
        print(f"{algo}, {seeds} seeds, {precision}: {rate:,.0f} updates/s", flush=True)
    for algo, environments in product(ALGORITHMS, (None, 8)):
        _whole_training(algo, seconds, environments=environments, **options)


def _updates_a_second(algo: str, seeds: int, **options: Any) -> float:
    """Returns the updates per second over all seeds, without robots."""
    engine = engine_with_transitions(seeds, algo, **options)
    (group,) = engine._groups
    rates = []
    for burst in range(BURSTS if options["device"] == "cuda" else 4):
        group.prepare(1 + burst * BURST, BURST)
        _wait(options["device"])
        began = time.perf_counter()
        group.run()
        _wait(options["device"])
        rates.append(seeds * BURST / (time.perf_counter() - began))
    # The first bursts load kernels and capture the graph.
    return median(rates[3:])


def _whole_training(algo: str, seconds: float, **options: Any) -> None:
    """Prints the control steps per second of ten seeds and a breakdown of the time."""
    changes = {} if algo == "ppo" else {"learning_starts": 500, "buffer_size": TRANSITIONS}
    settings = algorithm_settings(algo, overrides=changes)
    with make_engine(algo, settings, "face_direction", range(SEEDS), **options) as engine:
        clock, steps = Clock(engine), engine.learn(10**12)
        while engine.control_steps < WARM_UP:
            next(steps)
        clock.reset()
        first, began = engine.control_steps, time.perf_counter()
        while time.perf_counter() - began < seconds:
            next(steps)
        took = time.perf_counter() - began
        rate = SEEDS * (engine.control_steps - first) / took
        shares = ", ".join(f"{name} {spent / took:.0%}" for name, spent in clock.spent.items())
        print(
            f"{algo}, {SEEDS} seeds of {engine.environments.observations.shape[1]} environments: "
            f"{rate:,.0f} control steps/s ({shares})",
            flush=True,
        )


def _wait(device: str) -> None:
    if device == "cuda":
        torch.cuda.synchronize()


class Clock:
    """Measures the time of the parts of an engine's loop."""

    PARTS = ("_choose", "_remember", "_learn")

    def __init__(self, engine: Engine) -> None:
        """Starts measuring."""
        self.spent: dict[str, float] = {}
        for name in self.PARTS:
            self._watch(engine, name, name.strip("_"))
        self._watch(engine.environments, "step", "robots")

    def reset(self) -> None:
        """Resets the measured times."""
        self.spent = dict.fromkeys(self.spent, 0.0)

    def _watch(self, owner: Any, method: str, name: str) -> None:
        function = getattr(owner, method)
        self.spent[name] = 0.0

        def watched(*arguments: Any) -> Any:
            began = time.perf_counter()
            result = function(*arguments)
            self.spent[name] += time.perf_counter() - began
            return result

        setattr(owner, method, watched)


if __name__ == "__main__":
    torch.set_num_threads(1)
    while True:
        fraction_of_products(5)
