"""How often equal configurations get a verdict: `python benchmarks/verdict_rates.py`.

It simulates two configurations whose agents have the same distribution of returns, and counts the
verdicts at the first level of Holm's procedure for 38 comparisons, 0.05 / 38 or 0.13%: by the
interval alone, and by the interval with the permutation test that has to confirm it. Agents are
normal, or one in seven fails. An evaluation has ten episodes.
"""

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from jbench.array_types import BoolArray
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import Agents, deviation_difference
from jbench.statistics.permutation import p_value
from jbench.statistics.verdicts import ERROR_RATE, Evidence

COMPARISONS = 38
LEVEL = ERROR_RATE / COMPARISONS

EPISODES = 10
AGENT_DEVIATION = 50.0
EPISODE_DEVIATION = 100.0
BEST = 850.0
FAILED = 200.0
FAILURES = {"normal": 0.0, "one in seven fails": 1 / 7}
"""Probability that an agent fails, by the name of the distribution."""


def agents(seeds: int, failures: float, random: np.random.Generator) -> Agents:
    """Returns agents (seeds,) with the means and variances of their episodes."""
    expected = random.normal(BEST, AGENT_DEVIATION, seeds)
    expected[random.random(seeds) < failures] = FAILED
    returns = random.normal(expected[:, None], EPISODE_DEVIATION, (seeds, EPISODES))
    return Agents(
        returns.mean(axis=1),
        returns.var(axis=1, ddof=1) / EPISODES,
        np.full(seeds, float(EPISODES)),
    )


def verdicts(ours: Agents, theirs: Agents) -> BoolArray:
    """Returns whether there is a verdict on two configurations.

    Returns (2, 2): on final returns and on variability, by the interval alone and confirmed.
    """
    seeds = len(ours.means)
    sample = st.samples([st.difference(st.interquartile_mean)], [ours.means], [theirs.means])[0]
    of_returns = Evidence(sample.estimate, lambda _: p_value([ours.means], [theirs.means]), seeds)

    first, other = (np.abs(side.means - np.median(side.means)) for side in (ours, theirs))
    of_variability = Evidence(
        partial(deviation_difference, ours, theirs), lambda _: p_value([first], [other]), seeds
    )

    found = []
    for evidence in (of_returns, of_variability):
        interval_alone = replace(evidence, p_value=lambda _: 0.0)
        found.append([interval_alone.verdict(LEVEL), evidence.verdict(LEVEL)])

    is_decided: BoolArray = np.array(found) != "undecided"
    return is_decided


def main() -> None:
    """Prints the rates as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--comparisons", type=int, default=4000, help="simulated, of each row")
    comparisons = parser.parse_args().comparisons

    print(
        "| agents | seeds | final returns: interval | confirmed | variability: interval "
        "| confirmed |\n|---|---|---|---|---|---|"
    )
    for name, failures in FAILURES.items():
        for seeds in (6, 10):
            random = np.random.default_rng(0)
            found = np.zeros((2, 2))
            for _ in range(comparisons):
                ours, theirs = (agents(seeds, failures, random) for _ in range(2))
                found += verdicts(ours, theirs)
            rates = " | ".join(f"{rate:.2%}" for rate in found.ravel() / comparisons)
            print(f"| {name} | {seeds} | {rates} |", flush=True)


if __name__ == "__main__":
    main()
