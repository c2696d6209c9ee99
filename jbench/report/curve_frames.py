"""Frames of learning curves: across seeds, of each run, by processor time, and the paper's."""

from collections.abc import Collection, Iterable

import numpy as np
import pandas as pd

from jbench.report.data.configuration import ID, Curves
from jbench.report.data.curves import QUANTILE_COLUMNS, centers
from jbench.report.data.points import long_frame
from jbench.report.data.source_names import IMPORTED
from jbench.representation_names import kind_in, shown_representation
from jbench.returns import TRAINING
from jbench.settings.algorithms import display_name
from jbench.statistics import bootstrap as st

CURVES = [*ID, "steps", "seeds", "window", *QUANTILE_COLUMNS, "robots", "robot_steps"]
RUN_CURVES = ["configuration", "source", "run", "seed", "returns", "steps", "value"]
PUBLISHED_CURVES = [
    "task",
    "algo",
    "representation",
    "kind",
    "figure",
    "source",
    "seeds",
    "steps",
    *QUANTILE_COLUMNS,
]


def curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the points of curves, each of all seeds that have returns.

    steps is the center of the window, and window the episodes or evaluations that are averaged:
    fewer at the ends of a run. Quantiles other than the median are NaN for fewer than `MIN_SEEDS`
    seeds. robot_steps are the control steps with each robot of a sequence.
    """
    parts = []
    for config, curve in curves:
        arrays = {"steps": curve.control_steps, "window": curve.widths}
        banded = curve.seeds >= st.MIN_SEEDS
        for row, name in zip(curve.quantiles, QUANTILE_COLUMNS, strict=True):
            arrays[name] = row if banded or name == "median" else np.full(len(row), np.nan)
        robot_steps = config.robot_episodes * config.longest / config.returns.shape[1]
        names = {
            **config.identity,
            "seeds": curve.seeds,
            "robots": config.robots,
            "robot_steps": robot_steps,
        }
        parts.append((names, arrays))

    return long_frame(parts, CURVES)


def run_curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the learning curve of each run, at most 200 points."""
    parts = []
    for config, curve in curves:
        for run, seed, mine in zip(config.runs, config.seeds, curve.by_seed, strict=True):
            count = len(mine.values)
            shown = np.linspace(0, count - 1, min(count, 200)).round().astype(int)
            names = {**config.identity, "run": run, "seed": seed}
            arrays = {"steps": mine.control_steps[shown], "value": mine.values[shown]}
            parts.append((names, arrays))

    return long_frame(parts, RUN_CURVES)


def processor_frame(curves: Curves) -> pd.DataFrame:
    """Returns the median return against the median processor time (s) of the seeds.

    The time of a point is that at the center of its window, as for control steps. Only points at
    which every seed has a time count; otherwise the median could decrease. A seed that diverged
    has no time afterwards, and counts only in the return.
    """
    parts = []
    for config, curve in curves:
        times = config.common.processor_time[~config.diverged[config.common.known]]
        if not times.size:
            continue
        middle = np.median(times, axis=0)  # NaN where a seed has none
        # If some times of a window are missing, the mean of the others is not that at its center.
        usable = centers(np.isfinite(middle).astype(np.float64), curve.window) == 1
        seconds = centers(middle, curve.window)[usable]
        parts.append((config.identity, {"median": curve.quantile(50)[usable], "seconds": seconds}))

    return long_frame(parts, [*ID, "seconds", "median"])


def published_frame(
    published: pd.DataFrame,
    tasks: Iterable[str],
    algos: Collection[str] = (),
    imported: Curves = (),
) -> pd.DataFrame:
    """Returns the paper's curves of training returns on some tasks, with the names of a page.

    Imported curves that are drawn like them stand below. A figure that has only some quantiles
    leaves NaN.
    """
    shown = published[published["task"].isin([*tasks])]
    shown = shown[shown["algo"].isin(algos)] if algos else shown
    shown = shown.assign(algo=shown["algo"].map(display_name))
    names = shown["representation"]
    shown = shown.assign(kind=names.map(kind_in), representation=names.map(shown_representation))
    parts = [shown]
    if imported:
        parts.append(curve_frame(imported).assign(figure=IMPORTED))
    return pd.concat(parts, ignore_index=True)[PUBLISHED_CURVES]


def sequence_frame(curves: Curves, published: pd.DataFrame) -> pd.DataFrame:
    """Returns curves on sequences of robots, and the authors' up to the last step of ours.

    Theirs has ten robots with 1e6 control steps each.
    """
    ours = curve_frame(curves)
    longest = ours.groupby(["task", "algo"])["steps"].max()
    theirs = published_frame(published, {config.task for config, _ in curves})
    keys = pd.MultiIndex.from_frame(theirs[["task", "algo"]])
    theirs = theirs[theirs["steps"] <= longest.reindex(keys).to_numpy()]
    name = theirs["algo"] + " " + theirs["representation"] + ", published"
    theirs = theirs.assign(label=name, words=theirs["source"], returns=TRAINING)
    theirs = theirs.assign(configuration=theirs["task"] + " " + name, robots=10, robot_steps=1e6)
    return pd.concat([ours, theirs], ignore_index=True).reindex(columns=CURVES)
