"""How often intervals and tests of the variance between agents are right.

Simulates configurations of ten agents, whose expected returns have a standard deviation s and whose
episodes have w (`jbench/statistics/agents.py`). Prints how often the 95% interval of s
contains it, and for two configurations of equal s, how often that of the difference contains 0.

Run with: python benchmarks/agents_variance.py
"""

import argparse
from itertools import product

import numpy as np

from jbench.statistics.agents import Agents, components, deviation_difference

AGENTS = 10
SHAPES = ("normal", "skewed episodes", "skewed agents", "episodes of unequal variance")
CASES = {  # s, w of the first and of the second configuration, episodes
    "s = w / 3, 10 episodes": (50.0, 150.0, 150.0, 10),
    "s = w / 3, 100 episodes": (50.0, 150.0, 150.0, 100),
    "s = 0, 10 episodes": (0.0, 150.0, 150.0, 10),
    "w of 50 and 300, 10 episodes": (50.0, 50.0, 300.0, 10),
}


def draw(random: np.random.Generator, shape: str, s: float, w: float, episodes: int) -> Agents:
    """Returns agents; skewed: below the best by a distance with an exponential distribution."""
    size = AGENTS, episodes
    agents = -random.exponential(size=AGENTS) if "agents" in shape else random.normal(size=AGENTS)
    noise = (
        -random.exponential(size=size) if shape == "skewed episodes" else random.normal(size=size)
    )
    if "unequal" in shape:  # half of the agents vary four times as much as the others
        noise *= random.choice([0.343, 1.372], (AGENTS, 1))
    returns = s * agents[:, None] + w * noise
    variances = returns.var(axis=1, ddof=1) / episodes
    return Agents(returns.mean(axis=1), variances, np.full(AGENTS, float(episodes)))


def main() -> None:
    """Prints a row for each case and shape."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=2000)
    repetitions = parser.parse_args().repetitions
    print("| case | distribution | s covered | difference of s covered |")
    print("|---|---|---|---|")
    for (name, (s, *ws, episodes)), shape in product(CASES.items(), SHAPES):
        random, right = np.random.default_rng(0), np.zeros(2)
        for _ in range(repetitions):
            first, second = (draw(random, shape, s, w, episodes) for w in ws)
            alone, found = components(first), deviation_difference(first, second)
            right += alone.low <= s <= alone.high, found.low <= 0 <= found.high
        print(f"| {name} | {shape} |", *(f"{one:.1%} |" for one in right / repetitions), flush=True)


if __name__ == "__main__":
    main()
