"""Final returns: a forest plot, the variability of agents, pairs, profiles and comparisons."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.data.returns import SOLVED
from jbench.report.figures.chart import (
    Chart,
    Panel,
    add_points,
    numbers,
    series,
    shortened,
)
from jbench.report.frames import Frames
from jbench.report.style import Look

_ROW = 0.25  # inches
_POLICIES = {"random": "random actions", "hand-written": "hand-written policy"}


def forest(frames: Frames) -> Chart | None:
    """Returns the final returns of each configuration, and beside them their variability."""
    rows = frames.configurations[frames.configurations["returns"] == frames.returns]
    rows = rows[rows["seeds"] > 0]
    if len(rows) < 2:
        return None
    # The paper has only training returns.
    published = frames.configurations.groupby("configuration")["published"].max()
    rows = rows.assign(published=rows["configuration"].map(published))
    seeds = frames.seeds[frames.seeds["returns"] == frames.returns]
    looks = kind_looks(rows)
    panels = []
    for task, group in rows.groupby("task", sort=False):
        policies = frames.baselines[frames.baselines["task"] == task]
        height = 0.55 + _ROW * (len(group) + len(policies))
        draw = partial(
            draw_forest, group, seeds=seeds[seeds["task"] == task], policies=policies, looks=looks
        )
        panels.append(Panel(f"{task}: final return", {"": draw}, (5.2, height)))
        spread = group[group["s"].notna()] if "s" in group else group.iloc[:0]
        if len(spread) > 1:
            variability = partial(draw_variability, spread, looks=looks)
            height = 0.55 + _ROW * len(spread)
            panels.append(Panel(f"{task}: variability", {"": variability}, (5.2, height)))
    note = (
        "large mark: interquartile mean with 95% interval; dots: seeds with twice their standard "
        "error; |: the paper's training return"
    )
    return Chart(
        "returns", "Final returns", note, panels, "configurations", looks, columns=2, alike=False,
        minimum=440,
    )  # fmt: skip


def kind_looks(rows: pd.DataFrame) -> dict[str, Look]:
    """Returns a look for each kind of representation, by its name."""
    kinds = list(dict.fromkeys(rows["kind"]))
    return style.representation_looks([(kind, kind) for kind in kinds])


def draw_forest(
    rows: pd.DataFrame,
    axes: Axes,
    *,
    seeds: pd.DataFrame,
    policies: pd.DataFrame,
    looks: Mapping[str, Look],
) -> None:
    """Draws the final returns of a task: the interquartile mean, its interval, and all seeds.

    Args:
        rows: rows of `frames.configurations` of one task and kind of return.
        seeds: rows of `frames.seeds`.
        policies: rows of `frames.baselines`.
    """
    order = numbers(looks)
    for place, row in enumerate(rows.to_dict("records")):
        look, number = looks[row["kind"]], order[row["kind"]]
        _draw_seeds(
            axes, seeds[seeds["configuration"] == row["configuration"]], place, look, number
        )
        _draw_interval(axes, place, row["iqm"], row["iqm_low"], row["iqm_high"], look, number)
        interval = _interval(row["iqm"], row["iqm_low"], row["iqm_high"])
        tip = f"{row['label']}: {interval}, n = {row['seeds']}"
        add_points(axes, [row["iqm"]], [place], [tip], look, number, size=7.5)
        if np.isfinite(row["published"]):
            tip = f"{row['label']}, the paper's training return: {row['published']:.0f}"
            published = Look(look.color, (), "|")
            add_points(axes, [row["published"]], [place], [tip], published, number, size=11)
    for place, row in enumerate(policies.to_dict("records"), len(rows)):
        axes.plot([row["q10"], row["q90"]], [place] * 2, color=style.SOFT, linewidth=1)
        tip = f"{_POLICIES.get(row['policy'], row['policy'])}: median {row['median']:.0f}"
        tip += f" [{row['q10']:.0f}, {row['q90']:.0f}]" if np.isfinite(row["q10"]) else ""
        look = Look(style.SOFT, (), "D")
        add_points(axes, [row["median"]], [place], [tip], look, len(looks), size=5.5, hollow=True)
    axes.axvline(SOLVED, color=style.SOFT, linewidth=0.7)
    names = [*rows["label"], *(_POLICIES.get(name, name) for name in policies["policy"])]
    _name_rows(axes, names)
    high = max(1000.0, float(seeds["final"].max()) * 1.03) if len(seeds) else 1000.0
    axes.set_xlim(min(0.0, float(seeds["final"].min())) if len(seeds) else 0, high)


def _draw_seeds(axes: Axes, seeds: pd.DataFrame, place: int, look: Look, number: int) -> None:
    """Draws a dot for each seed, a little below its row, with twice the standard error."""
    seeds = seeds[seeds["final"].notna()]
    below = np.full(len(seeds), place + 0.27)
    error = 2 * seeds["episode_sd"] / np.sqrt(seeds["episodes"])
    axes.hlines(
        below, seeds["final"] - error, seeds["final"] + error, color=look.color, alpha=0.35,
        linewidth=0.8, gid=series(number),
    )  # fmt: skip
    tips = [
        f"seed {seed}: {final:.0f}" + (f" ± {twice:.0f}" if np.isfinite(twice) else "")
        for seed, final, twice in zip(seeds["seed"], seeds["final"], error, strict=True)
    ]
    add_points(axes, seeds["final"], below, tips, Look(look.color), number, size=3.2, alpha=0.6)


def draw_variability(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the standard deviation s between agents' expected returns; hollow if it may be 0.

    Args:
        rows: rows of `frames.configurations` of one task and kind of return, with s.
    """
    order = numbers(looks)
    for place, row in enumerate(rows.to_dict("records")):
        look, number = looks[row["kind"]], order[row["kind"]]
        value = max(row["s"], 0.0)
        _draw_interval(axes, place, value, row["s_low"], row["s_high"], look, number)
        tip = f"{row['label']}: s = {_interval(row['s'], row['s_low'], row['s_high'])}"
        add_points(
            axes, [value], [place], [tip], look, number, size=7.5, hollow=not row["s_low"] > 0
        )
    _name_rows(axes, rows["label"])
    # A few configurations with few seeds have intervals that would hide all others.
    ends = rows["s_high"][np.isfinite(rows["s_high"])]
    highest = max(
        1.0, 1.2 * float(rows["s"].max()), min(float(ends.max()), 3 * float(ends.median()))
    )
    axes.set_xlim(-0.02 * highest, highest)
    axes.set_xlabel("s, standard deviation")


def _draw_interval(
    axes: Axes, place: int, value: float, low: float, high: float, look: Look, number: int
) -> None:
    if np.isfinite(low):
        # An interval without an upper end reaches the edge.
        high = high if np.isfinite(high) else 1e6
        axes.plot(
            [low, high], [place] * 2, color=look.color, linewidth=2.2, solid_capstyle="butt",
            gid=series(number),
        )  # fmt: skip


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:.0f}" + (f" [{low:.0f}, {high:.0f}]" if np.isfinite(low) else "")


def _name_rows(axes: Axes, names: Sequence[str] | pd.Series) -> None:
    axes.set_yticks(range(len(names)), [shortened(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)


def comparisons(frames: Frames) -> Chart | None:
    """Returns the differences between the two sides of `--compare`."""
    rows = frames.comparisons
    rows = rows[rows["returns"] == frames.returns] if not rows.empty else rows
    if len(rows) < 2:
        return None
    looks = style.algorithm_looks([(name, name) for name in dict.fromkeys(rows["algo"])])
    first, other = rows[["a", "b"]].iloc[0]
    panels = [
        Panel(
            str(task),
            {"": partial(draw_differences, group, looks=looks)},
            (5.2, 0.6 + _ROW * len(group)),
        )
        for task, group in rows.groupby("task", sort=False)
    ]
    note = f"final return with {first} minus that with {other}; 95% interval"
    return Chart(
        "comparisons", "Differences", note, panels, "comparisons", looks, columns=2, minimum=440
    )


def draw_differences(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws differences of interquartile means with their intervals.

    Args:
        rows: rows of `frames.comparisons` of one task and kind of return.
    """
    order = numbers(looks)
    names = []
    for place, row in enumerate(rows.to_dict("records")):
        look, number = looks[row["algo"]], order[row["algo"]]
        names.append(
            ", ".join(filter(None, (f"{row['algo']} {row['representation']}", row["words"])))
        )
        _draw_interval(axes, place, row["difference"], row["low"], row["high"], look, number)
        tip = f"{names[-1]}: {_interval(row['difference'], row['low'], row['high'])}"
        add_points(axes, [row["difference"]], [place], [tip], look, number, size=7)
    axes.axvline(0, color=style.SOFT, linewidth=0.7)
    _name_rows(axes, names)
