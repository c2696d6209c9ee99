"""Frames of configurations and their seeds: statistics of final returns, and learning curves."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.names import kind_of
from jbench.report.analysis.examine import decide_solved
from jbench.report.analysis.scores import scores_of, statistics
from jbench.report.analysis.statistics import Estimate
from jbench.report.data.cells import (
    ID,
    Cell,
    display_name,
    shown_representation,
)
from jbench.report.data.curves import BAND_SEEDS, QUANTILES, Curve, centers
from jbench.report.data.published import (
    PUBLISHED,
    SEQUENCE_ROBOTS,
    PublishedCurve,
    best_beside,
    name_of_figure,
)
from jbench.report.data.returns import TRAINING

Curves = Sequence[tuple[Cell, Curve]]

_KEY = ("task", "algo", "representation", "variant", "source")
_QUANTILES = {f"q{percent}": "median" if percent == 50 else f"q{percent}" for percent in QUANTILES}
_STATISTICS = [
    f"{name}{end}"
    for name in ("median", "iqm", "over_run", "deviation", "solved_steps")
    for end in ("", "_low", "_high")
]
_SOLVED = {"supported": "yes", "contradicted": "no", "undecided": "undecided"}
CONFIGURATIONS = [
    *(*ID, "variant", "returns", "seeds", "draws", "steps_min", "steps", "diverged"),
    *(*_STATISTICS, "deviation_by_episodes", "s", "s_low", "s_high", "detectable"),
    *("reached", "solved"),
    *("published", "published_figure", "note"),
]
CURVES = [*ID, "returns", "steps", "seeds", "window", *_QUANTILES.values()]
PUBLISHED_NAMES = ("task", "algo", "representation", "kind", "figure", "source", "seeds")
RUN_CURVES = ["configuration", "source", "run", "seed", "returns", "steps", "value"]

_SHOWN_POINTS = 200  # of the curve of a single run


def configuration_frame(curves: Curves, published: Sequence[PublishedCurve]) -> pd.DataFrame:
    """Returns a row per configuration and kind of return, in the order of drawing.

    Columns: `ID`, variant (hash), returns (kind), seeds (with a final return), draws (of encoders),
    steps_min and steps (control steps of training), diverged (seeds); statistics, see
    `scores.statistics`; solved (whether the median is 900 or more: yes, no or undecided); published
    (median at the same control step) and published_figure; note.
    """
    rows = []
    for cell, curve in curves:
        row = statistics(cell, curve)
        seeds = len(scores_of(cell).final)
        median = Estimate(row["median"], row["median_low"], row["median_high"])
        value, figure = best_beside(cell, published) or (np.nan, None)
        rows.append(
            {
                **cell.identity,
                **{"variant": cell.variant, "returns": cell.kind.name, "seeds": seeds},
                **{"draws": cell.draws, "diverged": int(cell.diverged.sum())},
                **{"steps_min": int(cell.steps.min()), "steps": int(cell.steps.max())},
                **row,
                "solved": _SOLVED[decide_solved(median, seeds)[0]] if seeds else None,
                **{"published": value, "published_figure": figure and name_of_figure(figure)},
                "note": "; ".join(cell.notes),
            }
        )
    return pd.DataFrame(rows, columns=CONFIGURATIONS).astype({"reached": "Int64"})


def seed_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns a row per seed with a final return.

    Columns: `ID`, returns, seed, run, final (final return), over_run (mean return over the run),
    episodes (that the final return averages), episode_sd (their standard deviation; that of their
    mean is episode_sd / √episodes), diverged.
    """
    parts = []
    for cell in cells:
        scores = scores_of(cell)
        numbers = {"final": scores.final, "over_run": scores.area}
        numbers |= {"episodes": scores.episodes, "episode_sd": scores.deviations}
        runs = np.array(cell.runs, object)[scores.known]
        seeds = {"seed": cell.seeds[scores.known], "run": runs}
        diverged = cell.diverged[scores.known]
        names = {**cell.identity, "returns": cell.kind.name}
        parts.append(pd.DataFrame({**names, **seeds, **numbers, "diverged": diverged}))
    columns = ["seed", "run", "final", "over_run", "episodes", "episode_sd", "diverged"]
    empty = pd.DataFrame(columns=[*ID, "returns", *columns])
    return pd.concat(parts, ignore_index=True) if parts else empty


def curve_points(curves: Curves) -> pd.DataFrame:
    """Returns the points of all curves, sorted by the names of their configurations.

    Columns: task, algo, representation, variant, source, returns (their kind), order, window
    (episodes, or evaluations, averaged in this point: fewer at the ends of a run), control_steps
    (center of the window), seeds, and the return's quantiles q10, q25, q50, q75, q90.
    """
    columns = [*_KEY, "returns", "order", "window", "control_steps", "seeds", *_QUANTILES]
    ordered = sorted(curves, key=lambda one: (one[0].key, one[0].kind.name))
    parts = [
        pd.DataFrame(
            {
                **dict(zip(_KEY, cell.key, strict=True)),
                **{"returns": cell.kind.name, "order": curve.order, "window": curve.widths},
                **{"control_steps": curve.control_steps, "seeds": curve.seeds},
                **{f"q{percent}": curve.quantile(percent) for percent in QUANTILES},
            }
        )
        for cell, curve in ordered
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the points of curves in the order of drawing.

    Columns: `ID`, returns, steps, seeds, window, q10, q25, median, q75, q90; quantiles other than
    the median are NaN for fewer than `BAND_SEEDS` seeds. Points without a seed are left out. Curves
    on a sequence of robots also have robots and robot_steps (control steps with each robot).
    """
    parts = [pd.DataFrame(columns=[*CURVES, "robots", "robot_steps"])]
    for cell, curve in curves:
        points = curve_points([(cell, curve)]).rename(
            columns=_QUANTILES | {"control_steps": "steps"}
        )
        if len(cell.seeds) < BAND_SEEDS:
            points[["q10", "q25", "q75", "q90"]] = np.nan
        points = points[points["seeds"] > 0].assign(**cell.identity, robots=cell.robots)
        robot_steps = cell.robot_episodes * cell.longest / cell.returns.shape[1]
        parts.append(points.assign(robot_steps=robot_steps))
    frame = pd.concat(parts[1:] or parts, ignore_index=True)
    return frame[[*parts[0].columns]]


def run_curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the learning curve of each run, at most 200 points.

    Columns: configuration, source, run, seed, returns, steps, value.
    """
    parts = [pd.DataFrame(columns=RUN_CURVES)]
    for cell, curve in curves:
        for run, seed, values in zip(cell.runs, cell.seeds, curve.each, strict=True):
            shown = np.flatnonzero(np.isfinite(values))
            if len(shown) > _SHOWN_POINTS:
                shown = shown[np.linspace(0, len(shown) - 1, _SHOWN_POINTS).round().astype(int)]
            names = {"configuration": cell.configuration, "source": cell.source, "run": run}
            names |= {"seed": seed, "returns": cell.kind.name}
            points = {"steps": curve.control_steps[shown], "value": values[shown]}
            parts.append(pd.DataFrame({**names, **points}))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def processor_frame(curves: Curves) -> pd.DataFrame:
    """Returns the median return against the median processor time (s) of the seeds.

    The time of a point is that at the center of its window, as for control steps. Only points at
    which every seed has a time count; otherwise the median could decrease. A seed that diverged
    has no time afterwards, and counts only in the return.
    """
    columns = [*ID, "returns", "seconds", "median"]
    parts = [pd.DataFrame(columns=columns)]
    for cell, curve in curves:
        times = cell.processor_time[~cell.diverged]
        if not len(times):
            continue
        middle = np.median(times, axis=0)  # NaN where a seed has none
        # If some times of a window are missing, the mean of the others is not that at its center.
        known = centers(np.isfinite(middle).astype(np.float64), curve.window) == 1
        usable = known & np.isfinite(curve.quantile(50))
        seconds = centers(middle, curve.window)[usable]
        names = {**cell.identity, "returns": cell.kind.name}
        values = {"seconds": seconds, "median": curve.quantile(50)[usable]}
        parts.append(pd.DataFrame({**names, **values}))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def published_frame(
    published: Sequence[PublishedCurve], cells: Sequence[Cell], algo: str | None = None
) -> pd.DataFrame:
    """Returns the paper's curves of training returns on the tasks of these cells.

    Columns: task, algo, representation, kind, figure (`Figure 9`), source, seeds, steps, q10, q25,
    median, q75, q90; a figure that has only some quantiles leaves NaN.
    """
    columns = [*PUBLISHED_NAMES, "steps", *_QUANTILES.values()]
    tasks, parts = {cell.task for cell in cells}, [pd.DataFrame(columns=columns)]
    for one in published:
        if one.task in tasks and algo in (None, one.algo):
            quantiles = {_QUANTILES[f"q{q}"]: values for q, values in one.quantiles.items()}
            points = pd.DataFrame({**_names(one), "steps": one.control_steps, **quantiles})
            parts.append(points.reindex(columns=columns))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def _names(one: PublishedCurve) -> dict[str, str | int]:
    names = display_name(one.algo), shown_representation(one.representation)
    kind = kind_of(one.representation)
    values = one.task, *names, kind, one.figure_name, one.source, one.seeds
    return dict(zip(PUBLISHED_NAMES, values, strict=True))


def sequence_frame(curves: Curves, published: Sequence[PublishedCurve]) -> pd.DataFrame:
    """Returns curves on sequences of robots, and the authors' up to the last step of ours."""
    ours = curve_frame(curves)
    longest = ours.groupby(["task", "algo"])["steps"].max()
    theirs = published_frame(published, [cell for cell, _ in curves])
    keys = pd.MultiIndex.from_frame(theirs[["task", "algo"]])
    theirs = theirs[theirs["steps"] <= longest.reindex(keys).to_numpy()]
    name = theirs["algo"] + " " + theirs["representation"] + ", published"
    theirs = theirs.assign(configuration=theirs["task"] + " " + name, label=name, words=PUBLISHED)
    theirs = theirs.assign(returns=TRAINING.name, robots=SEQUENCE_ROBOTS, robot_steps=1e6)
    return pd.concat([ours, theirs.reindex(columns=ours.columns)], ignore_index=True)
