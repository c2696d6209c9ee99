"""Writes rliable's reference values for the tests of statistics, in a separate environment.

    python -m venv /tmp/rliable && /tmp/rliable/bin/pip install rliable==1.2.0 "pandas<3"
    /tmp/rliable/bin/python tests/statistics/rliable_oracle/make.py

rliable's own dependency arch does not work with pandas 3, which jbench uses.
"""

import json
from pathlib import Path

import numpy as np
from rliable import library, metrics

RESAMPLES = 5_000
THRESHOLDS = [100.0, 300.0, 500.0, 700.0, 900.0]


def scores(seed: int, runs: int, tasks: int) -> np.ndarray:
    """Returns skewed scores in [0, 1000] of shape (runs, tasks), with ties."""
    random = np.random.default_rng(seed)
    drawn = 1000 * random.beta(2, 1 + np.arange(tasks), (runs, tasks))
    return np.round(drawn / 25) * 25 if seed % 2 else drawn


def interval(given, statistic) -> list[float]:
    """Returns the 95% percentile interval."""
    np.random.seed(0)
    _, ends = library.get_interval_estimates(
        {"x": given}, lambda *x: np.array([statistic(*x)]), reps=RESAMPLES
    )
    return ends["x"][:, 0].tolist()


def case(seed: int, runs: int, others: int, tasks: int) -> dict:
    """Returns scores with rliable's estimates, intervals and profiles of them."""
    x, y = scores(seed, runs, tasks), scores(seed + 1, others, tasks)
    single = {
        "mean": metrics.aggregate_mean,
        "interquartile_mean": metrics.aggregate_iqm,
    }
    made = {name: {"value": float(f(x)), "interval": interval(x, f)} for name, f in single.items()}
    improvement = metrics.probability_of_improvement
    made["probability_of_improvement"] = {
        "value": float(improvement(x, y)),
        "interval": interval([x, y], improvement),
    }
    profile = library.score_distributions(x, np.array(THRESHOLDS))
    return {"x": x.tolist(), "y": y.tolist(), "made": made, "profile": profile.tolist()}


def main() -> None:
    """Writes the file."""
    cases = [case(0, 10, 10, 1), case(1, 10, 7, 1), case(2, 10, 10, 5), case(3, 5, 8, 4)]
    content = {"thresholds": THRESHOLDS, "cases": cases}
    Path(__file__).with_name("made.json").write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
