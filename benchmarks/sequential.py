"""Measures the power of the group-sequential test: `python benchmarks/sequential.py`.

Simulates the seeds of two cells, normally distributed with the same standard deviation, and tests
them after each block of five, as `jbench sweep --until-decided` does. Prints how often a shift is
found and the mean number of seeds, undecided comparisons included, and how often cells without a
difference are found equal within the margin.
"""

import argparse
import time

import numpy as np

from jbench.report.analysis import sequential
from jbench.report.analysis.claims import MARGIN

SHIFTS = (0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # standard deviations
SPREADS = (25.0, 35.0, 50.0, 75.0, 100.0)  # standard deviation in returns
AT_A_TIME = 50  # repetitions: 60 MB for each array


def simulate(
    arguments: argparse.Namespace, comparisons: int, shift: float, spread: float, margin: float
) -> tuple[float, float, float]:
    """Returns how often a difference is found, how often equality, and the mean number of seeds.

    Args:
        arguments: command-line arguments.
        comparisons: number of comparisons that share the error rate.
        shift: of the means, in units of the margin.
        spread: standard deviation, in the same units.
        margin: of equality; infinite to test for differences only.
    """
    random = np.random.default_rng(0)
    looks = arguments.max_seeds // sequential.BLOCK
    rate = sequential.ERROR_RATE / comparisons
    decided = []
    for _ in range(0, arguments.repetitions, AT_A_TIME):
        ours, theirs = random.normal(0, spread, (2, AT_A_TIME, arguments.max_seeds))
        pair, more = (ours + shift, theirs), {"relabelings": arguments.relabelings}
        if np.isinf(margin):
            sides = (pair, pair[::-1])
            larger, smaller = (
                sequential.first_above(*side, rate / 2, looks, **more) for side in sides
            )
            first = {"larger": larger, "smaller": smaller, "equal": np.zeros_like(larger)}
        else:
            first = sequential.first_looks(*pair, margin, rate, looks, **more)
        decided.append(np.stack([first[name] for name in ("larger", "smaller", "equal")]))
    reached = np.concatenate(decided, axis=1)
    order = np.where(reached > 0, reached, looks + 1)
    which, look = order.argmin(axis=0), np.minimum(order.min(axis=0), looks)
    found = order.min(axis=0) <= looks
    seeds = float(look.mean() * sequential.BLOCK)
    return float(np.mean(found & (which < 2))), float(np.mean(found & (which == 2))), seeds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=1000, help="of each simulation")
    parser.add_argument("--max-seeds", type=int, default=30)
    parser.add_argument("--comparisons", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--relabelings", type=int, default=20_000)
    arguments = parser.parse_args()
    began = time.monotonic()
    for comparisons in arguments.comparisons:
        print(f"\n{comparisons} comparisons, at most {arguments.max_seeds} seeds")
        print("shift in standard deviations   found    seeds")
        for shift in SHIFTS:
            found, _, seeds = simulate(arguments, comparisons, shift, 1.0, np.inf)
            print(f"{shift:28}  {found:6.3f}   {seeds:6.1f}", flush=True)
        print(f"no shift, margin {MARGIN:g}: standard deviation   equal   different   seeds")
        for spread in SPREADS:
            found, equal, seeds = simulate(arguments, comparisons, 0.0, spread, MARGIN)
            print(f"{spread:42}  {equal:6.3f}  {found:6.3f}  {seeds:6.1f}", flush=True)
    print(f"\n{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
