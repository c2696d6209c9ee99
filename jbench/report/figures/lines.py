"""Draws the curves of a panel, and the levels that they are compared with."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.data.returns import SOLVED
from jbench.report.figures.chart import add_tips, add_unseen, narrow, series, thinned
from jbench.report.style import Look

PUBLISHED = "published"
"""Entry of a legend for the curves of the paper."""

_ROOM = 0.09  # of the height of a panel, between words beside it


def draw_curves(
    rows: pd.DataFrame,
    axes: Axes,
    *,
    looks: Mapping[str, Look],
    order: Mapping[str, int],
    published: pd.DataFrame | None = None,
    baselines: pd.DataFrame | None = None,
    each: pd.DataFrame | None = None,
    each_seed: bool = False,
    scale: str = "linear",
    x: str = "environment steps",
    y: str = "return",
) -> None:
    """Draws the curves of a panel.

    Args:
        rows: rows of `frames.curves` of one kind of return, with a column `series`.
        order: the number of each series in the legend.
        published: rows of `frames.published`, with a column `series`.
        baselines: rows of `frames.baselines` of the task.
        each: `frames.run_curves`; drawn where there are too few seeds for a band.
    """
    alpha = 0.16 if rows["series"].nunique() < 5 else 0.1
    for (name, _), curve in rows.groupby(["series", "configuration"], sort=False):
        look, number = looks[str(name)], order[str(name)]
        curve = curve.iloc[thinned(len(curve))]
        steps, median = curve["steps"].to_numpy(), curve["median"].to_numpy()
        axes.plot(
            steps,
            median,
            color=look.color,
            linestyle=look.linestyle,
            gid=series(number),
            zorder=2.5,
        )
        add_tips(axes, steps, median, _tips(str(name), curve), look, number)
        if curve["q10"].notna().any():
            axes.fill_between(
                steps, curve["q10"], curve["q90"], color=look.color, alpha=alpha, linewidth=0,
                gid=series(number),
            )  # fmt: skip
        if each is not None and (each_seed or curve["q10"].isna().all()):
            _draw_each(axes, each, curve, look, number)
    if published is not None:
        _draw_published(axes, published, looks, order)
    _set_axes(axes, rows, scale)
    axes.set(xlabel=x, ylabel=y)
    _draw_levels(axes, baselines)


def _tips(name: str, curve: pd.DataFrame) -> list[str]:
    """Returns the tip of each point: its median, band and number of seeds."""
    seeds = curve["seeds"] if "seeds" in curve else curve["q10"] * np.nan
    columns = (curve["steps"], curve["median"], curve["q10"], curve["q90"], seeds)
    return [
        f"{name} at {f'{at:,.0f}' if at >= 100 else f'{at:.3g}'}: {median:.0f}"
        + ("" if np.isnan(low) else f" [{low:.0f}, {high:.0f}]")
        + ("" if np.isnan(count) else f", n = {count:.0f}")
        for at, median, low, high, count in zip(*(c.tolist() for c in columns), strict=True)
    ]


def _draw_each(
    axes: Axes, each: pd.DataFrame, curve: pd.DataFrame, look: Look, number: int
) -> None:
    """Draws each seed of a curve as a thin line."""
    first = curve.iloc[0]
    chosen = (each["configuration"] == first["configuration"]) & (
        each["returns"] == first.get("returns")
    )
    if not chosen.any() or first["seeds"] < 2:
        return
    width = mpl.rcParams["lines.linewidth"] / 2
    for _, seed in each[chosen].groupby("run", sort=False):
        axes.plot(
            seed["steps"], seed["value"], color=look.color, alpha=0.5, linewidth=width,
            gid=series(number),
        )  # fmt: skip


def _draw_published(
    axes: Axes, published: pd.DataFrame, looks: Mapping[str, Look], order: Mapping[str, int]
) -> None:
    number = order.get(PUBLISHED, len(order))
    dotted = (0, style.PUBLISHED_DASH)
    for (name, _), curve in published.groupby(["series", "source"], sort=False):
        look = looks.get(str(name), Look(style.SOFT))
        called = " ".join(curve[["algo", "representation"]].iloc[0])
        curve = curve.iloc[thinned(len(curve), 100)]
        steps, median = curve["steps"].to_numpy(), curve["median"].to_numpy()
        axes.plot(steps, median, color=look.color, linestyle=dotted, gid=series(number))
        tips = [
            f"{called}, published, at {at:,.0f}: {value:.0f}"
            for at, value in zip(steps, median, strict=True)
        ]
        shown = thinned(len(steps), 20)
        add_unseen(axes, steps[shown], median[shown], [tips[i] for i in shown], number)


def _set_axes(axes: Axes, rows: pd.DataFrame, scale: str) -> None:
    low, high = float(rows["median"].min()), float(rows["median"].max())
    axes.set_ylim(min(0.0, low * 1.05), max(1000.0, high * 1.05))
    axes.set_xscale(scale)
    if scale == "log":
        positive = rows["steps"][rows["steps"] > 0]
        axes.set_xlim(left=float(positive.min()) * 0.95)
        subs = (1, 2, 5) if not narrow(axes) or rows["steps"].max() < 10 * positive.min() else (1,)
        axes.xaxis.set_major_locator(ticker.LogLocator(subs=subs, numticks=8))
        axes.xaxis.set_minor_locator(ticker.NullLocator())
    else:
        axes.set_xlim(left=0)
        axes.xaxis.set_major_locator(ticker.MaxNLocator(4 if narrow(axes) else 6))
    axes.xaxis.set_major_formatter(ticker.EngFormatter(sep=""))


def _draw_levels(axes: Axes, baselines: pd.DataFrame | None) -> None:
    """Draws the returns of policies without training and that of a solved task."""
    levels = {"solved": float(SOLVED)}
    if baselines is not None:
        levels |= dict(zip(baselines["policy"], baselines["median"], strict=True))
    for name, level in levels.items():
        dash = "-" if name == "solved" else (0, (3, 2))
        axes.axhline(level, color=style.SOFT, linewidth=0.7, linestyle=dash, zorder=1)
    low, high = axes.get_ylim()
    place = -np.inf
    levels = {} if narrow(axes, 1.5) else levels
    for name, level in sorted(levels.items(), key=lambda item: item[1]):
        place = max((level - low) / (high - low), place + _ROOM)
        axes.text(
            1.02, place, str(name), transform=axes.transAxes, va="center",
            size=mpl.rcParams["font.size"] * 0.9, color=style.SOFT,
        )  # fmt: skip
