"""Frames of configurations and their seeds: statistics of final returns, and learning curves."""

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from jbench.names import kind_in
from jbench.report.analysis.claims import decide_solved
from jbench.report.analysis.scores import seed_scores, statistics
from jbench.report.data.configuration import (
    ID,
    Configuration,
    concatenated,
    display_name,
    shown_representation,
)
from jbench.report.data.curves import BAND_SEEDS, QUANTILES, Curve, centers
from jbench.report.data.published import NAMES, PUBLISHED, SEQUENCE_ROBOTS, best_beside
from jbench.report.data.returns import TRAINING
from jbench.statistics.bootstrap import Estimate

Curves = Sequence[tuple[Configuration, Curve]]

_STATISTICS = [
    f"{name}{end}"
    for name in ("median", "iqm", "over_run", "deviation", "solved_steps")
    for end in ("", "_low", "_high")
]
_SOLVED = {"supported": "yes", "contradicted": "no", "undecided": "undecided"}
CONFIGURATIONS = [
    *(*ID, "variant", "returns", "seeds", "draws", "steps_min", "steps", "diverged"),
    *(*_STATISTICS, "deviation_by_episodes", "s", "s_low", "s_high", "detectable"),
    *("reached", "solved", "published", "published_figure", "note"),
]
SEEDS = [
    *(*ID, "returns", "seed", "run", "final", "over_run", "episodes", "episode_sd", "diverged"),
]
CURVES = [
    *(*ID, "returns", "steps", "seeds", "window", *NAMES.values(), "robots", "robot_steps"),
]
RUN_CURVES = ["configuration", "source", "run", "seed", "returns", "steps", "value"]
PROCESSOR = [*ID, "returns", "seconds", "median"]
PUBLISHED_CURVES = [
    *("task", "algo", "representation", "kind", "figure", "source", "seeds", "steps"),
    *NAMES.values(),
]
POINTS = [
    *("task", "algo", "representation", "variant", "source", "returns", "order", "window"),
    *("control_steps", "seeds", *(f"q{percent}" for percent in QUANTILES)),
]

_SHOWN_POINTS = 200  # of the curve of a single run


def configuration_frame(curves: Curves, published: pd.DataFrame) -> pd.DataFrame:
    """Returns a row per configuration and kind of return, in the order of drawing.

    Columns: `ID`, variant (hash), returns (kind), seeds (with a final return), draws (of encoders),
    steps_min and steps (control steps of training), diverged (seeds); statistics, see
    `scores.statistics`; solved (whether the median is 900 or more: yes, no or undecided); published
    (median at the same control step) and published_figure; note.
    """
    rows = []
    for one, curve in curves:
        row = statistics(one, curve)
        seeds = len(seed_scores(one).final)
        median = Estimate(row["median"], row["median_low"], row["median_high"])
        value, figure = best_beside(one, published) or (np.nan, None)
        rows.append(
            {
                **one.identity,
                **{"variant": one.variant, "returns": one.kind, "seeds": seeds},
                **{"draws": one.draws, "diverged": int(one.diverged.sum())},
                **{"steps_min": int(one.steps.min()), "steps": int(one.steps.max())},
                **row,
                "solved": _SOLVED[decide_solved(median, seeds)[0]]
                if seeds and one.has_solved_return
                else None,
                **{"published": value, "published_figure": figure, "note": "; ".join(one.notes)},
            }
        )
    return pd.DataFrame(rows, columns=CONFIGURATIONS).astype({"reached": "Int64"})


def seed_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns a row per seed with a final return.

    Columns: `ID`, returns, seed, run, final (final return), over_run (mean return over the run),
    episodes (that the final return averages), episode_sd (their standard deviation; that of their
    mean is episode_sd / √episodes), diverged.
    """
    parts = []
    for one in configurations:
        scores = seed_scores(one)
        numbers = {"seed": one.seeds, "run": np.array(one.runs, object), "diverged": one.diverged}
        numbers = {name: values[scores.known] for name, values in numbers.items()}
        numbers |= {"final": scores.final, "over_run": scores.area}
        numbers |= {"episodes": scores.episodes, "episode_sd": scores.deviations}
        parts.append(pd.DataFrame({**one.identity, "returns": one.kind, **numbers}))
    return concatenated(parts, SEEDS)


def curve_points(curves: Curves) -> pd.DataFrame:
    """Returns the points of all curves, sorted by the names of their configurations.

    Columns: task, algo, representation, variant, source, returns (their kind), order, window
    (episodes, or evaluations, averaged in this point: fewer at the ends of a run), control_steps
    (center of the window), seeds, and the return's quantiles q10, q25, q50, q75, q90.
    """
    ordered = sorted(curves, key=lambda pair: (pair[0].key, pair[0].kind))
    return concatenated([_points(*pair) for pair in ordered], POINTS)


def _points(configuration: Configuration, curve: Curve) -> pd.DataFrame:
    names = {"returns": configuration.kind, "order": curve.order, "window": curve.widths}
    numbers = {"control_steps": curve.control_steps, "seeds": curve.seeds}
    quantiles = {f"q{percent}": curve.quantile(percent) for percent in QUANTILES}
    return pd.DataFrame(
        {**dict(zip(POINTS[:5], configuration.key, strict=True)), **names, **numbers, **quantiles}
    )


def curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the points of curves in the order of drawing.

    Columns: `ID`, returns, steps, seeds, window, q10, q25, median, q75, q90; quantiles other than
    the median are NaN for fewer than `BAND_SEEDS` seeds. Points without a seed are left out. Curves
    on a sequence of robots have robots and robot_steps (control steps with each robot).
    """
    parts = []
    for one, curve in curves:
        points = _points(one, curve).rename(columns={**NAMES, "control_steps": "steps"})
        if len(one.seeds) < BAND_SEEDS:
            points[["q10", "q25", "q75", "q90"]] = np.nan
        robot_steps = one.robot_episodes * one.longest / one.returns.shape[1]
        points = points.assign(**one.identity, robots=one.robots, robot_steps=robot_steps)
        parts.append(points[points["seeds"] > 0])
    return concatenated(parts, CURVES)


def run_curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the learning curve of each run, at most 200 points.

    Columns: configuration, source, run, seed, returns, steps, value.
    """
    parts = []
    for one, curve in curves:
        for run, seed, values in zip(one.runs, one.seeds, curve.each, strict=True):
            shown = np.flatnonzero(np.isfinite(values))
            if len(shown) > _SHOWN_POINTS:
                shown = shown[np.linspace(0, len(shown) - 1, _SHOWN_POINTS).round().astype(int)]
            names = one.configuration, one.source, run, seed, one.kind
            points = {"steps": curve.control_steps[shown], "value": values[shown]}
            parts.append(pd.DataFrame({**dict(zip(RUN_CURVES, names, strict=False)), **points}))
    return concatenated(parts, RUN_CURVES)


def processor_frame(curves: Curves) -> pd.DataFrame:
    """Returns the median return against the median processor time (s) of the seeds.

    The time of a point is that at the center of its window, as for control steps. Only points at
    which every seed has a time count; otherwise the median could decrease. A seed that diverged
    has no time afterwards, and counts only in the return.
    """
    parts = []
    for one, curve in curves:
        times = one.processor_time[~one.diverged]
        if not len(times):
            continue
        middle = np.median(times, axis=0)  # NaN where a seed has none
        # If some times of a window are missing, the mean of the others is not that at its center.
        known = centers(np.isfinite(middle).astype(np.float64), curve.window) == 1
        usable = known & np.isfinite(curve.quantile(50))
        names = {**one.identity, "returns": one.kind, "median": curve.quantile(50)[usable]}
        parts.append(pd.DataFrame({**names, "seconds": centers(middle, curve.window)[usable]}))
    return concatenated(parts, PROCESSOR)


def published_frame(
    published: pd.DataFrame, tasks: Iterable[str], algo: str | None = None
) -> pd.DataFrame:
    """Returns the paper's curves of training returns on some tasks, with the names of a page.

    Columns: task, algo, representation, kind, figure (`Figure 9`), source, seeds, steps, q10, q25,
    median, q75, q90; a figure that has only some quantiles leaves NaN.
    """
    shown = published[published["task"].isin([*tasks])]
    shown = shown if algo is None else shown[shown["algo"] == algo]
    names = {
        "algo": shown["algo"].map(display_name),
        "kind": shown["representation"].map(kind_in),
        "representation": shown["representation"].map(shown_representation),
    }
    return shown.assign(**names)[PUBLISHED_CURVES].reset_index(drop=True)


def sequence_frame(curves: Curves, published: pd.DataFrame) -> pd.DataFrame:
    """Returns curves on sequences of robots, and the authors' up to the last step of ours."""
    ours = curve_frame(curves)
    longest = ours.groupby(["task", "algo"])["steps"].max()
    theirs = published_frame(published, {one.task for one, _ in curves})
    keys = pd.MultiIndex.from_frame(theirs[["task", "algo"]])
    theirs = theirs[theirs["steps"] <= longest.reindex(keys).to_numpy()]
    name = theirs["algo"] + " " + theirs["representation"] + ", published"
    theirs = theirs.assign(configuration=theirs["task"] + " " + name, label=name, words=PUBLISHED)
    theirs = theirs.assign(returns=TRAINING, robots=SEQUENCE_ROBOTS, robot_steps=1e6)
    return concatenated([ours, theirs], CURVES)
