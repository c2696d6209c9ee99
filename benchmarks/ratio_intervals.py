"""How often intervals of equal configurations exclude "no difference".

    python benchmarks/ratio_intervals.py

Simulates comparisons of two configurations with the same distribution of returns, and counts how
often the 95% bootstrap interval of a report excludes the truth: a ratio of standard deviations of
1, a difference of interquartile means of 0. The nominal rate is 5%.
"""

import argparse
from itertools import product

import numpy as np

from jbench.statistics import bootstrap as st

SEEDS = (3, 4, 5, 6, 10)
RESAMPLES = 1000


def draw(kind: str, seeds: int, random: np.random.Generator) -> np.ndarray:
    """Returns final returns (seeds,): normal, or below the best by an exponential distance."""
    return random.normal(size=seeds) if kind == "normal" else -random.exponential(size=seeds)


def main() -> None:
    """Prints the rate of wrong intervals for each distribution and number of seeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--comparisons", type=int, default=4000)
    comparisons = parser.parse_args().comparisons
    statistics = [st.ratio(st.standard_deviation), st.difference(st.interquartile_mean)]
    random = np.random.default_rng(0)
    print("| returns | seeds | ratio of standard deviations | difference of interquartile means |")
    print("|---|---|---|---|")
    for kind, seeds in product(("normal", "exponential"), SEEDS):
        wrong = np.zeros(2)
        for _ in range(comparisons):
            groups = [draw(kind, seeds, random)], [draw(kind, seeds, random)]
            drawn = st.samples(statistics, *groups, resamples=RESAMPLES)
            ends = [sample.estimate() for sample in drawn]
            wrong += [not e.low <= truth <= e.high for e, truth in zip(ends, (1, 0), strict=True)]
        rates = " | ".join(f"{rate:.1%}" for rate in wrong / comparisons)
        print(f"| {kind} | {seeds} | {rates} |", flush=True)


if __name__ == "__main__":
    main()
