"""The results that golden frames are of: the shipped runs, imported curves, and diverged runs.

`python -m tests.report.golden.cases` writes the frames again.
"""

import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.store import Results
from jbench.store.shipped import shipped_results
from tests.report.conftest import FabricatedResults, import_curves

GOLDEN = Path(__file__).parent
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
    return Frames(fabric.results, Request(claims=True))


def imported(fabric):
    """Six seeds each of two imported algorithms, beside runs of two representations."""
    _add_runs(fabric, "full", 500.0, seeds=6)
    _add_runs(fabric, "dae12", 350.0, seeds=6)
    random = np.random.default_rng(0)
    for algo, end in {"slow": 400.0, "fast": 800.0}.items():
        curves = {seed: _curve(random, end + 20 * seed).round(3) for seed in range(6)}
        import_curves(fabric.results.path, algo, curves)
    return Frames(Results(fabric.results.path), Request(claims=True))


@cache
def shipped_frames():
    """Returns the frames of the shipped runs, which a process computes once."""
    return Frames(shipped_results(), Request(claims=True))


CASES = {"shipped": lambda fabric: shipped_frames(), "imported": imported, "diverged": diverged}

KEYS = {
    "configurations": ["configuration", "returns"],
    "curves": ["configuration", "returns", "steps"],
    "pairs": ["a", "b", "returns"],
    "verdicts": ["configuration", "returns", "against", "claim"],
    "claims": ["source", "returns", "compared", "claim", "verdict"],
    "encoders": ["task", "representation", "settings"],
    "predictions": ["configuration", "returns", "quantity"],
    "decisions": ["task", "algo", "representation", "against", "verdict"],
}
"""Columns that name a row of each frame, whose numbers are golden."""


def frames(case, directory):
    return CASES[case](FabricatedResults(directory / "results"))


def numbers(frame, name):
    """Returns the names and numbers of a frame, but those that change with the rows beside it."""
    columns = [column for column in frame.select_dtypes("number") if "corrected" not in column]
    frame = frame.astype(dict.fromkeys(columns, float))
    frame = frame[list(dict.fromkeys([*KEYS[name], *columns]))]
    return frame.assign(place=frame.groupby(KEYS[name]).cumcount())  # of several with equal names


def write():
    """Writes the frames of all cases; of curves, every 30th point."""
    for case in CASES:
        with tempfile.TemporaryDirectory() as directory:
            found = frames(case, Path(directory))
        for name in KEYS:
            rows = numbers(getattr(found, name), name)
            if name == "curves":
                rows = rows[rows.groupby(KEYS[name][:2]).cumcount() % 30 == 0]
            if len(rows):
                rows.to_csv(GOLDEN / f"{case}-{name}.csv", index=False)


if __name__ == "__main__":
    sys.exit(write())
