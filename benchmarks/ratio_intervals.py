"""How often intervals of equal configurations exclude "no difference".

    python benchmarks/ratio_intervals.py

Simulates comparisons of two configurations of ten seeds with the same distribution of returns, and
counts how often the 95% bootstrap interval of a report excludes the truth: a ratio of standard
deviations of 1, a difference of interquartile means of 0. The nominal rate is 5%.
"""

import argparse

import numpy as np

from jbench.statistics import bootstrap as st

SEEDS, RESAMPLES = 10, 1000


def draw(kind: str, random: np.random.Generator) -> np.ndarray:
    """Returns final returns (seeds,): normal, or below the best by an exponential distance."""
    return random.normal(size=SEEDS) if kind == "normal" else -random.exponential(size=SEEDS)


def main() -> None:
    """Prints the rate of wrong intervals for each distribution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--comparisons", type=int, default=4000)
    comparisons = parser.parse_args().comparisons
    statistics = [st.ratio(st.standard_deviation), st.difference(st.interquartile_mean)]
    random = np.random.default_rng(0)
    print("| returns | ratio of standard deviations | difference of interquartile means |")
    print("|---|---|---|")
    for kind in ("normal", "exponential"):
        wrong = np.zeros(2)
        for _ in range(comparisons):
            groups = [draw(kind, random)], [draw(kind, random)]
            drawn = st.samples(statistics, *groups, resamples=RESAMPLES)
            ends = [sample.estimate() for sample in drawn]
            wrong += [not e.low <= truth <= e.high for e, truth in zip(ends, (1, 0), strict=True)]
        print(f"| {kind} | {wrong[0] / comparisons:.1%} | {wrong[1] / comparisons:.1%} |")


if __name__ == "__main__":
    main()
