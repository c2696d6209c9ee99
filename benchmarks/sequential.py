"""Measures the group-sequential test: `python benchmarks/sequential.py`.

Simulates the seeds of configurations, normally distributed with the same standard deviation, and
tests them after each block of five, as `jbench sweep --until-decided` does. Prints

- for two configurations with equal means, how often one is found to be better, also if their
  distributions differ otherwise;
- for comparisons with the same baseline, how often one or more decisions are wrong, and how many of
  the differences are found, with Bonferroni's equal rates and with the step-down procedure;
- how often a shift is found and the mean number of seeds, undecided comparisons included;
- how often configurations without a difference are found equal within the margin.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np

from jbench.array_types import FloatArray
from jbench.statistics import sequential
from jbench.statistics.step_down import step_down
from jbench.statistics.verdicts import DIRECTIONS, ERROR_RATE, Verdict
from jbench.studies.quantities import MARGIN

SHIFTS = (0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # standard deviations
SPREADS = (25.0, 35.0, 50.0, 75.0, 100.0)  # standard deviation in returns
FAMILIES = ((0.0,) * 8, (4.0,) * 4 + (0.0,) * 4, (4.0,) * 4 + (1.5,) * 4, (4.0,) * 7 + (1.5,))
SIGNS = {"larger": 1, "smaller": -1, "equal": 0, "undecided": 0}
FAILURES = 1 / 7  # share of the agents of a configuration
LOSS = 13.0  # of a failed agent, in standard deviations of the others
PLANNED = (1, 2, 6)  # analyses
AT_A_TIME = 50  # repetitions: 60 MB for each array


def agents(kind: str, seeds: int, random: np.random.Generator) -> FloatArray:
    """Returns agents (repetitions, seeds) with a mean of 0, as a kind distributes them."""
    drawn = random.normal(size=(AT_A_TIME, seeds))
    if kind == "varying":
        return 4 * drawn
    if kind == "failing":
        failed = random.random(drawn.shape) < FAILURES
        return drawn + LOSS * FAILURES - LOSS * failed

    return drawn


def wrong_decisions(kinds: tuple[str, str], analyses: int, arguments: argparse.Namespace) -> float:
    """Returns how often one of two kinds of agents with equal means is found to be better."""
    random = np.random.default_rng(0)
    found = []
    for _ in range(0, arguments.repetitions, AT_A_TIME):
        ours, theirs = (agents(kind, analyses * sequential.BLOCK, random) for kind in kinds)
        decided = [
            sequential.decided_at(
                verdict,
                ours,
                theirs,
                0,
                ERROR_RATE,
                analyses,
                relabelings=arguments.relabelings,
            )
            for verdict in DIRECTIONS
        ]
        found.append(np.any(decided, axis=0))

    return float(np.mean(found))


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
    analyses = arguments.max_seeds // sequential.BLOCK
    rate = ERROR_RATE / comparisons
    names: list[Verdict] = ["larger", "smaller", "equal"]
    decided = []
    for _ in range(0, arguments.repetitions, AT_A_TIME):
        ours, theirs = random.normal(0, spread, (2, AT_A_TIME, arguments.max_seeds))
        tested = names[:2] if np.isinf(margin) else names
        first = [
            sequential.decided_at(
                name,
                ours + shift,
                theirs,
                margin,
                rate,
                analyses,
                relabelings=arguments.relabelings,
            )
            for name in tested
        ]
        decided.append(np.stack([*first, np.zeros_like(first[0])][:3]))
    reached = np.concatenate(decided, axis=1)
    order = np.where(reached > 0, reached, analyses + 1)
    which, analysis = order.argmin(axis=0), np.minimum(order.min(axis=0), analyses)
    found = order.min(axis=0) <= analyses
    seeds = float(analysis.mean() * sequential.BLOCK)
    return float(np.mean(found & (which < 2))), float(np.mean(found & (which == 2))), seeds


def simulate_family(
    shifts: tuple[float, ...], repetitions: int, analyses: int = 3, relabelings: int = 4000
) -> dict[str, tuple[float, float, float]]:
    """Returns error rate, differences found, and small differences found, by procedure.

    Args:
        shifts: (comparisons,) of each configuration from the same baseline, in standard deviations.
        repetitions: number of simulated families.
        analyses: planned interim analyses.
        relabelings: see `sequential.first_above`.
    """
    random, count, true = np.random.default_rng(0), len(shifts), np.array(shifts)
    theirs = random.normal(size=(repetitions, analyses * sequential.BLOCK))
    ours = random.normal(size=(count, *theirs.shape)) + true[:, None, None]
    at: dict[tuple[str, int], np.ndarray] = {}
    for parts in range(count + 1, 2 * count + 1):
        rate = 2 * ERROR_RATE / parts
        for name in ("larger", "smaller"):
            first = [
                sequential.decided_at(name, one, theirs, 0, rate, analyses, relabelings=relabelings)
                for one in ours
            ]
            at[name, parts] = np.stack(first)
    shares = [ERROR_RATE / count] * count
    signs: dict[str, list[Sequence[int]]] = {"Bonferroni": [], "step-down": []}
    for r in range(repetitions):

        def reached(i: int, verdict: Verdict, rate: float, r: int = r) -> int:
            parts = round(2 * ERROR_RATE / rate)
            return 0 if verdict == "equal" else int(at[verdict, parts][i, r])

        steps = step_down(reached, shares, analyses)
        verdicts = ["undecided" if step is None else step.verdict for step in steps]
        signs["step-down"].append([SIGNS[verdict] for verdict in verdicts])
        larger, smaller = (at[name, 2 * count][:, r] > 0 for name in ("larger", "smaller"))
        signs["Bonferroni"].append((larger.astype(int) - smaller).tolist())
    found = {}
    for name, rows in signs.items():
        decided = np.array(rows)
        right = decided == np.sign(true)
        wrong = np.any((decided != 0) & ~right, axis=1).mean()
        small = (true > 0) & (true == true[true > 0].min(initial=np.inf))
        found[name] = (
            wrong,
            *(right[:, which].mean() if which.any() else np.nan for which in (true > 0, small)),
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=1000, help="of each simulation")
    parser.add_argument("--max-seeds", type=int, default=30)
    parser.add_argument("--comparisons", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--relabelings", type=int, default=20_000)
    arguments = parser.parse_args()
    began = time.monotonic()
    print("equal means   planned analyses   wrong")
    for kinds in (("normal", "normal"), ("normal", "varying"), ("normal", "failing")):
        for analyses in PLANNED:
            wrong = wrong_decisions(kinds, analyses, arguments)
            print(f"{' and '.join(kinds):20}  {analyses}   {wrong:6.3f}", flush=True)
    print("\nshifts of comparisons with one baseline   procedure   wrong   found   smallest found")
    for shifts in FAMILIES:
        for name, numbers in simulate_family(shifts, arguments.repetitions).items():
            texts = "   ".join(f"{number:6.3f}" for number in numbers)
            print(f"{' '.join(map('{:g}'.format, shifts)):40}  {name:10}  {texts}", flush=True)
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
