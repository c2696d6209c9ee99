"""The results that golden frames are of: the shipped runs, imported curves, and diverged runs."""

import numpy as np
import pandas as pd

from jbench.cli import main
from jbench.report.request import Request
from jbench.store import Results
from jbench.store.shipped import shipped_results

STEPS = [10_000, 20_000, 30_000, 40_000]


def _curve(random, end):
    return np.clip(np.linspace(0, end, 40) + random.normal(0, 40, 40), 0, 1000)


def _add_runs(fabric, representation, end, *, diverged=(), seeds=7):
    """Adds a run per seed, whose returns rise; some diverge after 25,000 steps."""
    random = np.random.default_rng(len(representation) + int(end))
    for seed in range(seeds):
        returns = _curve(random, end + 30 * seed)
        ended = 25 if seed in diverged else 40
        fabric.run(
            returns[:ended],
            seed,
            steps=40_000,
            representation=representation,
            evaluated={s: float(returns[s // 1000 - 1]) for s in STEPS if s <= ended * 1000},
            diverged=25_000 if seed in diverged else None,
        )


def diverged(fabric):
    """Three representations of seven seeds, of which one and two diverge."""
    _add_runs(fabric, "full", 500.0)
    _add_runs(fabric, "scaled16", 650.0, diverged=(3,))
    _add_runs(fabric, "dae12", 300.0, diverged=(0, 5))
    return fabric.results, Request(claims=True)


def imported(fabric):
    """Six seeds each of two imported algorithms, beside runs of two representations."""
    _add_runs(fabric, "full", 500.0, seeds=6)
    _add_runs(fabric, "dae12", 350.0, seeds=6)
    random = np.random.default_rng(0)
    for algo, end in {"slow": 400.0, "fast": 800.0}.items():
        file = fabric.results.path.parent / f"{algo}.csv"
        parts = [
            pd.DataFrame(
                {
                    "seed": seed,
                    "control_steps": np.arange(1, 41) * 1000,
                    "episode_return": _curve(random, end + 20 * seed).round(3),
                }
            )
            for seed in range(6)
        ]
        pd.concat(parts).to_csv(file, index=False)
        typed = ("--from", "csv", "--task", "face_direction", "--algo", algo)
        where = ("--seed-column", "seed", "--results", str(fabric.results.path), str(file))
        assert main(["import", *typed, *where]) == 0
    return Results(fabric.results.path), Request(claims=True)


def shipped(fabric):
    """The runs and encoders that jbench ships."""
    return shipped_results(), Request(claims=True)


CASES = {"shipped": shipped, "imported": imported, "diverged": diverged}
