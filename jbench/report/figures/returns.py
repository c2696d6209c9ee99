"""Final returns and other numbers in rows: forest plots, differences, errors of encoders."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.figures.chart import Chart, Panel, by_task
from jbench.report.figures.marks import (
    PLAIN,
    ROW,
    add_points,
    add_rows,
    add_solved,
    interval_text,
    name_rows,
    narrow,
)
from jbench.report.frames import Frames
from jbench.report.style import Look

_FLOOR = 1e-3  # smaller fractions of unexplained variance are drawn here
_POLICIES = {"random": "random actions", "hand-written": "hand-written policy"}
_NARROW = 3  # representations with R² from which a figure is drawn


def forest(frames: Frames) -> Chart | None:
    """Returns the final returns of each configuration, and beside them their variability."""
    rows = frames.configurations[frames.configurations["returns"] == frames.returns]
    rows = rows[rows["seeds"] > 0]
    if len(rows) < 2:
        return None
    # The paper has only training returns.
    published = frames.configurations.groupby("configuration")["published"].max()
    rows = rows.assign(published=rows["configuration"].map(published), name=rows["label"])
    seeds = frames.seeds[frames.seeds["returns"] == frames.returns]
    looks = style.representation_looks(rows, "kind")
    panels = []
    for task, group in rows.groupby("task", sort=False):
        policies = frames.baselines[frames.baselines["task"] == task]
        height = 0.55 + ROW * (len(group) + len(policies))
        draw = partial(draw_forest, group, looks=looks, seeds=seeds, policies=policies)
        panels.append(Panel(f"{task}: final return", {"": draw}, (5.2, height)))
        known = group[group["s"].notna()]
        if len(known) > 1:
            draw, height = partial(draw_variability, known, looks=looks), 0.55 + ROW * len(known)
            panels.append(Panel(f"{task}: variability", {"": draw}, (5.2, height)))
    note = (
        "large mark: interquartile mean with 95% interval; dots: seeds with twice their standard "
        "error; |: the paper's training return"
    )
    return Chart(
        "returns", "Final returns", note, panels, "configurations", looks,
        columns=2, alike=False, minimum=440,
    )  # fmt: skip


def draw_forest(
    rows: pd.DataFrame,
    axes: Axes,
    *,
    looks: Mapping[str, Look],
    seeds: pd.DataFrame,
    policies: pd.DataFrame,
) -> None:
    """Draws the final returns of a task: the interquartile mean, its interval, and all seeds.

    Args:
        rows: rows of `frames.configurations` of one task and kind of return.
        seeds: rows of `frames.seeds`.
        policies: rows of `frames.baselines`.
    """
    seeds = seeds[seeds["configuration"].isin(rows["configuration"]) & seeds["final"].notna()]
    for place, row in enumerate(rows.to_dict("records")):
        look, mine = looks[row["kind"]], seeds[seeds["configuration"] == row["configuration"]]
        final, below = mine["final"], np.full(len(mine), place + 0.27)
        error = 2 * mine["episode_sd"] / np.sqrt(mine["episodes"])
        axes.hlines(
            below, final - error, final + error, color=look.color, alpha=0.35, linewidth=0.8,
            gid=look.series,
        )  # fmt: skip
        tips = [
            f"seed {seed}: {value:.0f}" + (f" ± {twice:.0f}" if np.isfinite(twice) else "")
            for seed, value, twice in zip(mine["seed"], final, error, strict=True)
        ]
        add_points(axes, final, below, tips, look._replace(marker="o"), size=3.2, alpha=0.6)
        if np.isfinite(row["published"]):
            tip = f"{row['name']}, the paper's training return: {row['published']:.0f}"
            add_points(axes, [row["published"]], [place], [tip], look._replace(marker="|"), size=11)
    add_rows(axes, rows, looks, value="iqm", ends=("iqm_low", "iqm_high"))
    names = [_POLICIES.get(name, name) for name in policies["policy"]]
    apart = Look(style.SOFT, (), "D", len(looks))
    for place, row in enumerate(policies.to_dict("records"), len(rows)):
        axes.plot([row["q10"], row["q90"]], [place] * 2, color=style.SOFT, linewidth=1)
        numbers = interval_text(row["median"], row["q10"], row["q90"])
        tip = f"{names[place - len(rows)]}: median {numbers}"
        add_points(axes, [row["median"]], [place], [tip], apart, size=5.5, hollow=True)
    add_solved(axes, rows["task"])
    name_rows(axes, [*rows["name"], *names])
    ends = np.array([0.0, 1000.0, *seeds["final"]])
    axes.set_xlim(ends.min(), ends.max() * (1.03 if ends.max() > 1000 else 1))


def draw_variability(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the standard deviation s between agents' expected returns; hollow if it may be 0.

    Args:
        rows: rows of `frames.configurations` of one task and kind of return, with s.
    """
    add_rows(
        axes, rows, looks, value="s", ends=("s_low", "s_high"),
        hollow=~(rows["s_low"].to_numpy() > 0),
    )  # fmt: skip
    # A few configurations with few seeds have intervals that would hide all others.
    ends = rows["s_high"][np.isfinite(rows["s_high"])]
    widest = min(float(ends.max()), 3 * float(ends.median()))
    highest = max(1.0, 1.2 * float(rows["s"].max()), widest)
    axes.set_xlim(-0.02 * highest, highest)
    axes.set_xlabel("s, standard deviation")


def comparisons(frames: Frames) -> Chart | None:
    """Returns the differences between the two sides of `--compare`."""
    rows = frames.comparisons[frames.comparisons["returns"] == frames.returns]
    if len(rows) < 2:
        return None
    words = [f", {one}" if one else "" for one in rows["words"]]
    rows = rows.assign(name=rows["algo"] + " " + rows["representation"] + words)
    looks = style.algorithm_looks(rows, "algo")

    def draw(group: pd.DataFrame, axes: Axes) -> None:
        add_rows(axes, group, looks, value="difference", ends=("low", "high"), look="algo")
        axes.axvline(0, color=style.SOFT, linewidth=0.7)

    panels = by_task(rows, draw, 5.2, 0.6 + ROW * rows.groupby("task").size().max())
    first, other = rows[["a", "b"]].iloc[0]
    note = f"final return with {first} minus that with {other}; 95% interval"
    name = "comparisons"
    return Chart(name, "Differences", note, panels, name, looks, columns=2, minimum=440)


def errors(frames: Frames) -> Chart | None:
    """Returns the errors of encoders: a row each, or by number of latents if sizes differ."""
    rows = frames.encoders
    if len(rows) < 2:
        return None
    settings = rows["settings"].fillna("")
    unsized = rows["representation"].str.replace(r"(?<=[a-z])\d+", "", n=1, regex=True)
    rows = rows.assign(series=(unsized + " " + settings).str.strip())
    rows = rows.assign(name=(rows["representation"] + " " + settings).str.strip())
    looks = style.representation_looks(rows, "series")
    panels = []
    for task, group in rows.groupby("task", sort=False):
        by_size = group.groupby("series")["latents"].nunique().max() > 1
        size = (4.2, 2.6) if by_size else (5.2, 0.7 + ROW * len(group))
        draw = partial(draw_errors, group.sort_values("latents") if by_size else group, looks=looks)
        panels.append(Panel(str(task), {"": draw}, size))
    note = "filled: held-out episodes of the dataset; hollow: episodes of the hand-written policy"
    return Chart(
        "encoders", "Reconstruction error by encoder", note, panels, "encoders", looks,
        columns=2, alike=False, minimum=440,
    )  # fmt: skip


def draw_errors(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the unexplained variance of encoders.

    Args:
        rows: rows of `frames.encoders` of one task, with columns `series` and `name`; several
            sizes of a series are drawn against the number of latents.
    """
    by_size = rows.groupby("series")["latents"].nunique().max() > 1
    places = dict(zip(rows["name"], range(len(rows)), strict=False))
    # The filled mark is the smaller one, so that both are seen where errors are equal.
    for column, hollow in (("heuristic", True), ("test", False)):
        for name, group in rows[rows[column].notna()].groupby("series", sort=False):
            look, errors = looks[str(name)], group[column].clip(lower=_FLOOR)
            tips = [
                f"{one}: {value:.3g} not explained"
                for one, value in zip(group["name"], group[column], strict=True)
            ]
            if by_size:
                width = 0.8 if hollow else 1.6
                line: Any = {"color": look.color, "linestyle": look.line, "linewidth": width}
                axes.plot(group["latents"], errors, gid=look.series, **line)
                add_points(axes, group["latents"], errors, tips, look, size=5, hollow=hollow)
            else:
                at = group["name"].map(places)
                add_points(axes, errors, at, tips, look, size=8 if hollow else 5, hollow=hollow)
    if by_size:
        axes.set(xlabel="latents", ylabel="variance not explained", yscale="log")
        axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
        axes.yaxis.set_major_formatter(PLAIN)
    else:
        name_rows(axes, rows["name"])
        axes.set(xscale="log", xlabel="fraction of the variance not explained")
        axes.xaxis.set_major_formatter(PLAIN)


def predictions(frames: Frames) -> Chart | None:
    """Returns final returns against what latents predict of the next control step."""
    rows = frames.predictions
    looks = style.representation_looks(rows, "representation")
    panels = [
        Panel(f"{task}, {algo}", {"": partial(draw_predictions, points, looks=looks)}, (3.2, 2.3))
        for (task, algo), group in rows.groupby(["task", "algo"], sort=False)
        if group["configuration"].nunique() >= _NARROW
        for _, points in group.groupby("quantity", sort=False)
    ]
    if not panels:
        return None
    note = "interquartile mean with 95% interval against R² one step ahead; correlation only"
    return Chart(
        "predictions", "Return against what latents predict", note, panels, "predictions", looks,
        columns=4, alike=False, minimum=260,
    )  # fmt: skip


def draw_predictions(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws final returns against an R².

    Args:
        rows: rows of `frames.predictions` of one task, algorithm and quantity.
    """
    for row in rows.to_dict("records"):
        look, at = looks[row["representation"]], max(row["r2"], 0.0)
        if np.isfinite(row["low"]):
            axes.plot([at, at], [row["low"], row["high"]], color=look.color, gid=look.series)
        tip = f"{row['label']}: {row['iqm']:.0f}, R² {row['r2']:.2f}"
        add_points(axes, [at], [row["iqm"]], [tip], look, size=6)
    axes.set(xlabel=f"R² of the {rows['quantity'].iloc[0]}", ylabel="final return")
    axes.set(xlim=(-0.03, 1.03), ylim=(0, 1000))
    if narrow(axes):
        axes.xaxis.set_major_locator(ticker.MaxNLocator(3))
