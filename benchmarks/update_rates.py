"""Measures updates without the robots: `python benchmarks/update_rates.py`.

`--busy` makes such updates until it is killed, to keep a core busy.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from statistics import median

import torch
from torch import Tensor

from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.environments import Environments
from jbench.names import Precision
from jbench.settings.algorithms import algorithm_settings

BATCH, OBSERVATION, HIDDEN = 256, 16, (350, 250)
TRANSITIONS = 100_000
UPDATES = 50  # of a burst, as DDPG makes them
BURSTS = 30


def engine_with_transitions(seeds: int, precision: Precision) -> OffPolicyEngine:
    """Returns agents of DDPG whose replay buffers are full of random numbers."""
    settings = algorithm_settings("ddpg", overrides={"buffer_size": TRANSITIONS})
    robots = Environments("face_direction", range(seeds))
    engine = make_batched_engine("ddpg", settings, robots, precision=precision)
    assert isinstance(engine, OffPolicyEngine)
    rows = torch.randn(1, TRANSITIONS, OBSERVATION + 2)
    for seed in range(seeds):
        engine.replay.restore(seed, rows, TRANSITIONS)
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


def fraction_of_products(
    seeds: int, precision: Precision = "float32", bursts: int = BURSTS, updates: int = UPDATES
) -> tuple[float, float, float]:
    """Returns the seconds of an update, those of its products alone, and their ratio.

    Both alternate, in processor time of this thread, which depends little on other processes.
    """
    engine, alone = engine_with_transitions(seeds, precision), products()
    times: list[tuple[float, float]] = []
    for burst in range(bursts // seeds + 2):
        for group in engine.group_updates:
            group.prepare(1 + burst * updates, updates)
            began = time.thread_time()
            group.run()
            update = time.thread_time() - began
            began = time.thread_time()
            for _ in range(updates):
                alone()
            times.append((update / updates, (time.thread_time() - began) / updates))
    times = times[seeds:]
    return (
        median(update for update, _ in times),
        median(its for _, its in times),
        median(its / update for update, its in times),
    )


def cpu_rows(bursts: int = BURSTS, updates: int = UPDATES) -> None:
    """Prints the rows of one core while a second process keeps the other core busy."""
    torch.set_num_threads(1)
    with subprocess.Popen([sys.executable, __file__, "--busy"]) as other:
        try:
            precisions: tuple[Precision, ...] = ("float32", "bfloat16")
            for precision in precisions:
                update, alone, part = fraction_of_products(5, precision, bursts, updates)
                print(
                    f"DDPG's update in {precision}: {update * 1e3:.2f} ms per core, its products "
                    f"alone in float32 {alone * 1e3:.2f} ms: {part:.2f} of the rate of products",
                    flush=True,
                )
        finally:
            other.kill()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bursts", type=int, default=BURSTS, help="bursts of updates")
    parser.add_argument("--updates", type=int, default=UPDATES, help="updates of a burst")
    parser.add_argument("--busy", action="store_true", help="go on until killed; print nothing")
    arguments = parser.parse_args()
    if not arguments.busy:
        cpu_rows(arguments.bursts, arguments.updates)
        return
    torch.set_num_threads(1)
    while True:
        fraction_of_products(5)


if __name__ == "__main__":
    main()
