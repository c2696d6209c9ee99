"""Frames of configurations and their seeds: statistics of final returns, and learning curves."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import kind_in, shown_representation
from jbench.report.analysis.findings import decide_solved
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configuration
from jbench.report.data.curves import NAMES, Curve, SeedCurve, best_median, centers
from jbench.report.data.points import long_frame
from jbench.report.data.source_names import IMPORTED
from jbench.returns import TRAINING
from jbench.settings.algorithms import display_name
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import components, smallest_difference
from jbench.task_specs import SOLVED_RETURN

Curves = Sequence[tuple[Configuration, Curve]]

_ENDS = ("", "_low", "_high")
_STATISTICS = ("median", "iqm", "over_run", "deviation", "solved_steps")
_FINAL = {"median": st.median, "iqm": st.interquartile_mean, "deviation": st.standard_deviation}
_IS_SOLVED = {"supported": "yes", "contradicted": "no", "undecided": "undecided"}
CONFIGURATIONS = [
    *ID,
    "variant",
    "seeds",
    "draws",
    "steps_min",
    "steps",
    "diverged",
    *(f"{name}{end}" for name in _STATISTICS for end in _ENDS),
    "deviation_by_episodes",
    "s",
    "s_low",
    "s_high",
    "detectable",
    "reached",
    "solved",
    "published",
    "published_figure",
    "note",
]
SEEDS = [*ID, "seed", "run", "final", "over_run", "episodes", "episode_sd", "diverged"]
CURVES = [*ID, "steps", "seeds", "window", *NAMES.values(), "robots", "robot_steps"]
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
    *NAMES.values(),
]


def configuration_frame(curves: Curves, published: pd.DataFrame) -> pd.DataFrame:
    """Returns a row per configuration and kind of return, in the order of drawing.

    Columns: `ID`, variant (hash), seeds (with a final return), draws (of encoders),
    steps_min and steps (control steps of training), diverged (seeds). Statistics with the ends of
    their 95% intervals (…_low, …_high): median, iqm (interquartile mean) and deviation (standard
    deviation) of the final returns, over_run (interquartile mean of the mean return over the run),
    solved_steps (median of the control steps to a return of `SOLVED_RETURN`; infinite: after the
    runs' end; NaN for a sequence of robots), s (standard deviation between agents).

    Without intervals: deviation_by_episodes (standard deviation of final returns if all agents were
    equally good), detectable (smallest difference of means that two such configurations show),
    reached (seeds that reach `SOLVED_RETURN`), solved (whether the median is at least that: yes, no
    or undecided), published (the paper's median at the same control step) and published_figure,
    note.
    """
    rows = []
    for config, curve in curves:
        scores = seed_scores(config)
        row: dict[str, Any] = {
            **config.identity,
            "variant": config.variant,
            "seeds": len(scores.final),
            "draws": config.draws,
            "steps_min": int(config.steps.min()),
            "steps": int(config.steps.max()),
            "diverged": int(config.diverged.sum()),
            "solved": None,
            "published_figure": None,
            "note": "; ".join(config.notes),
        }
        row |= _intervals(_FINAL, scores.final)
        row |= _intervals({"over_run": st.interquartile_mean}, scores.area)
        row["deviation_by_episodes"] = scores.deviation_by_episodes
        if scores.agents.known and len(scores.final) >= st.MIN_SEEDS:
            row["s"], row["s_low"], row["s_high"], w = components(scores.agents)
            row["detectable"] = smallest_difference(
                len(scores.final), row["s"], w, scores.episodes.mean()
            )

        if config.robots <= 1 and config.has_solved_return:
            steps = _solved_steps(curve.by_seed)
            row |= _intervals({"solved_steps": st.median}, steps)
            row["reached"] = int(np.isfinite(steps).sum())
        if row["seeds"] and config.has_solved_return:
            median = st.Estimate(*(row[f"median{end}"] for end in _ENDS))
            row["solved"] = _IS_SOLVED[decide_solved(median, row["seeds"]).verdict]
        if config.kind == TRAINING:  # the paper has no other returns
            names = config.task, config.algo, config.representation
            if best := best_median(published, names, scores.middle, sequence=config.robots > 1):
                row["published"], row["published_figure"] = best

        rows.append(row)

    return pd.DataFrame(rows, columns=CONFIGURATIONS).astype({"reached": "Int64"})


def _solved_steps(curves: Sequence[SeedCurve]) -> FloatArray:
    """Returns the control step at which a whole window of each seed first has `SOLVED_RETURN`."""
    first = []
    for curve in curves:
        solved = (curve.values >= SOLVED_RETURN) & (curve.widths == curve.window)
        if len(curve.values):
            first.append(curve.control_steps[solved].min(initial=np.inf))
    return np.array(first)


def _intervals(statistics: Mapping[str, st.Statistic], scores: FloatArray) -> dict[str, float]:
    """Returns statistics with the ends of their intervals, by the names of columns."""
    samples = st.samples(list(statistics.values()), [scores])
    return {
        f"{name}{end}": number
        for name, sample in zip(statistics, samples, strict=True)
        for end, number in zip(_ENDS, sample.estimate(), strict=False)
    }


def seed_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns a row per seed with a final return.

    over_run is the mean return over the run. A final return averages episodes with the standard
    deviation episode_sd; that of their mean is episode_sd / √episodes.
    """
    parts = []
    for config in configurations:
        scores = seed_scores(config)
        known = scores.known
        arrays = {
            "seed": config.seeds[known],
            "run": np.array(config.runs, object)[known],
            "diverged": config.diverged[known],
            "final": scores.final,
            "over_run": scores.area,
            "episodes": scores.episodes,
            "episode_sd": scores.deviations,
        }
        parts.append((config.identity, arrays))

    return long_frame(parts, SEEDS)


def curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the points of curves, each of all seeds that have returns.

    steps is the center of the window, and window the episodes or evaluations that are averaged:
    fewer at the ends of a run. Quantiles other than the median are NaN for fewer than `MIN_SEEDS`
    seeds. robot_steps are the control steps with each robot of a sequence.
    """
    parts = []
    for config, curve in curves:
        arrays = {"steps": curve.control_steps, "window": curve.widths}
        banded = len(config.seeds) >= st.MIN_SEEDS
        for row, name in zip(curve.quantiles, NAMES.values(), strict=True):
            arrays[name] = row if banded or name == "median" else np.full(len(row), np.nan)
        robot_steps = config.robot_episodes * config.longest / config.returns.shape[1]
        names = {**config.identity, "seeds": curve.seeds, "robots": config.robots}
        parts.append(({**names, "robot_steps": robot_steps}, arrays))

    return long_frame(parts, CURVES)


def run_curve_frame(curves: Curves) -> pd.DataFrame:
    """Returns the learning curve of each run, at most 200 points."""
    parts = []
    for config, curve in curves:
        for run, seed, mine in zip(config.runs, config.seeds, curve.by_seed, strict=True):
            count = len(mine.values)
            shown = np.linspace(0, count - 1, min(count, 200)).round().astype(int)
            arrays = {"steps": mine.control_steps[shown], "value": mine.values[shown]}
            parts.append(({**config.identity, "run": run, "seed": seed}, arrays))
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
    published: pd.DataFrame, tasks: Iterable[str], algo: str | None = None, imported: Curves = ()
) -> pd.DataFrame:
    """Returns the paper's curves of training returns on some tasks, with the names of a page.

    Imported curves that are drawn like them stand below. A figure that has only some quantiles
    leaves NaN.
    """
    shown = published[published["task"].isin([*tasks])]
    shown = shown if algo is None else shown[shown["algo"] == algo]
    shown = shown.assign(algo=shown["algo"].map(display_name))
    names = {"kind": kind_in, "representation": shown_representation}
    parts = [shown.assign(**{name: shown["representation"].map(f) for name, f in names.items()})]
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
