"""Which runs reach the higher return: pairs of configurations, and performance profiles."""

from collections.abc import Mapping
from functools import partial

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import colors
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.data.returns import SOLVED
from jbench.report.figures.chart import (
    Chart,
    Panel,
    add_unseen,
    numbers,
    series,
    shortened,
    thinned,
)
from jbench.report.frames import Frames
from jbench.report.style import Look

_PROFILES = 6  # lines that can be told apart
_SHARES = colors.LinearSegmentedColormap.from_list("share", ["#e08214", "#f3f1ee", "#4d8fc4"])
_DARK = "#1a1f27"  # text on the light colors of the pairs, in both themes


def pairs(frames: Frames) -> Chart | None:
    """Returns the probability that a run of one configuration ends above one of another."""
    panels = []
    for task, rows in frames.pairs.groupby("task", sort=False):
        # Those that are compared with one other only, such as of another length, say little.
        counts = rows.groupby("a")["b"].nunique()
        kept = counts.index[counts > 1]
        rows = rows[rows["a"].isin(kept) & rows["b"].isin(kept)]
        count = rows["a"].nunique()
        if count > 2:
            draw = partial(draw_pairs, rows)
            panels.append(Panel(str(task), {"": draw}, (5.2, 1.4 + 0.33 * count)))
    if not panels:
        return None
    note = "percentage of pairs of runs in which the row's ends above the column's; bold: decided"
    return Chart(
        "pairs", "Which reaches the higher return", note, panels, "pairs", {}, columns=2,
        alike=False, minimum=440,
    )  # fmt: skip


def draw_pairs(rows: pd.DataFrame, axes: Axes) -> None:
    """Draws a matrix of probabilities.

    Args:
        rows: rows of `frames.pairs` of one task.
    """
    names = list(dict.fromkeys(rows["a_label"]))
    share = rows.pivot_table(index="a_label", columns="b_label", values="p").reindex(
        index=names, columns=names
    )
    axes.pcolormesh(share.to_numpy(), cmap=_SHARES, vmin=0, vmax=1, edgecolors="none")
    for row in rows.to_dict("records"):
        axes.text(
            names.index(row["b_label"]) + 0.5, names.index(row["a_label"]) + 0.5,
            f"{100 * row['p']:.0f}", ha="center", va="center", color=_DARK,
            weight="bold" if row["decided"] else "normal", size=mpl.rcParams["font.size"] * 0.9,
        )  # fmt: skip
    middles = np.arange(len(names)) + 0.5
    shown = [shortened(name) for name in names]
    axes.set_yticks(middles, shown)
    axes.set_xticks(middles, shown, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_ylim(len(names), 0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def profiles(frames: Frames) -> Chart | None:
    """Returns the share of runs above each return, of tasks with few enough configurations."""
    rows = frames.profiles
    if rows.empty:
        return None
    lines = rows.groupby("task")["label"].transform("nunique")
    rows = rows[(lines > 1) & (lines <= _PROFILES)]
    if rows.empty:
        return None
    rows = rows.assign(series=rows["label"])
    looks = style.representation_looks(
        list(rows[["series", "kind"]].drop_duplicates().itertuples(index=False, name=None))
    )
    panels = [
        Panel(str(task), {"": partial(draw_profiles, group, looks=looks)}, (5.2, 2.8))
        for task, group in rows.groupby("task", sort=False)
    ]
    note = "share of runs that end above a return; bands: 95% intervals"
    return Chart("profiles", "Performance profiles", note, panels, "profiles", looks)


def draw_profiles(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the share of runs above each return.

    Args:
        rows: rows of `frames.profiles` of one task, with a column `series`.
    """
    order = numbers(looks)
    for name, line in rows.groupby("series", sort=False):
        look, number = looks[str(name)], order[str(name)]
        values = line[["share", "low", "high"]]
        steps = (values != values.shift()).any(axis=1) | (values != values.shift(-1)).any(axis=1)
        line = line[steps]
        x, share = line["final_return"].to_numpy(), line["share"].to_numpy()
        axes.step(
            x, share, where="post", color=look.color, linestyle=look.linestyle, gid=series(number)
        )
        axes.fill_between(
            x, line["low"], line["high"], step="post", color=look.color, alpha=0.12, linewidth=0,
            gid=series(number),
        )  # fmt: skip
        shown = thinned(len(x), 40)
        tips = [f"{name}: {100 * share[i]:.0f}% above {x[i]:.0f}" for i in shown]
        add_unseen(axes, x[shown], share[shown], tips, number)
    axes.axvline(SOLVED, color=style.SOFT, linewidth=0.7)
    axes.set(xlabel="final return", ylabel="share of runs above", ylim=(-0.02, 1.02))
    axes.set_xlim(left=0)
