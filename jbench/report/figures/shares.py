"""Shares: pairs of configurations, performance profiles, motor velocities and positions."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import colors
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.analysis.all_tasks import ALL_TASKS, NORMALIZED
from jbench.report.figures import cells, marks
from jbench.report.figures.chart import ROWS, Chart, by_task
from jbench.report.frames import Frames
from jbench.report.policies import FULL_SPEED
from jbench.statistics.verdicts import DECIDING_SEEDS

_PROFILES = 6  # lines that can be told apart
_TARGET = "#d00000"
# Widths in font sizes: a letter of a name, a cell with room for "16", and for a bold "100". A panel
# is as many times as wide as its axes before they are placed.
_PANEL = 1.25
_LETTER = 0.56
_COLUMN = 1.6
_HUNDRED = 2.35


def pairs(frames: Frames) -> Chart:
    """Returns the probability that a run of a configuration has a higher final return."""
    lengths = zip(frames.pairs["task"], frames.pairs["steps"], strict=True)
    rows = frames.pairs.assign(title=[f"{task}: {n:,} control steps" for task, n in lengths])
    rows = rows[rows.groupby("title")["a"].transform("nunique") > 2]  # two alone say little
    note = (
        "percentage of pairs of runs in which the row's reaches the higher final return than the "
        "column's; bold: decided, as in the verdicts or corrected for the number of pairs"
    )
    panels = by_task(
        rows, _draw_pairs, lambda rows: (5.2, 0.5 + 0.33 * rows["a"].nunique()), by=["title"]
    )
    return Chart("pairs", "Probability of improvement", note, panels, **ROWS)


def _draw_pairs(rows: pd.DataFrame, axes: Axes) -> None:
    """Draws the share of pairs of runs in which one configuration beats another."""
    names = list(dict.fromkeys(rows["a_label"]))
    shares = rows.pivot_table(index="a_label", columns="b_label", values="p")
    shares = shares.reindex(index=names, columns=names)

    numbered = [f"{i}. {name}" for i, name in enumerate(marks.shortened(names), 1)]
    numbers = [str(i) for i in range(1, len(names) + 1)]
    cells.draw_cells(axes, shares, numbered, numbers)
    usual = mpl.rcParams["font.size"]
    panel = _PANEL * axes.bbox.width * 72 / axes.figure.dpi / usual
    width = (panel - _LETTER * max(map(len, numbered))) / len(names)  # of a cell
    axes.tick_params("x", labelsize=usual * min(1, width / _COLUMN))
    size = usual * min(0.9, width / _HUNDRED)
    for row in rows.to_dict("records"):
        weight = "bold" if row["decided"] else "normal"
        cells.write_cell(axes, shares, row["a_label"], row["b_label"], weight=weight, size=size)


def profiles(frames: Frames) -> Chart:
    """Returns the share of runs above each return, for few configurations of enough seeds."""
    # The seeds of several tasks together are those of all, and each task needs enough.
    together = frames.profiles["task"].isin([ALL_TASKS, NORMALIZED])
    tasks = frames.profiles.groupby("label")["task"].transform("nunique") - 1
    enough = DECIDING_SEEDS * tasks.where(together, 1)
    rows = frames.profiles[frames.profiles["seeds"] >= enough]
    lines = rows.groupby("task")["label"].transform("nunique")
    rows = rows[(lines > 1) & (lines <= _PROFILES)]
    looks = style.looks(rows, "label")
    every = frames.profiles[frames.profiles["task"] != ALL_TASKS]

    def draw(rows: pd.DataFrame, axes: Axes) -> None:
        for name, line in rows.groupby("label", sort=False):
            points = line[["final_return", "share", "low", "high"]].to_numpy(float)
            changes = (points[1:, 1:] != points[:-1, 1:]).any(axis=1)
            points = points[np.append(True, changes) | np.append(changes, True)]
            tips = [f"{name}: {100 * y:.0f}% above {at:g}" for at, y in points[:, :2].tolist()]
            marks.add_line(axes, points, tips, looks[str(name)], step="post")

        marks.add_solved(axes, every if ALL_TASKS in {*rows["task"]} else rows)
        axes.set(xlabel="final return", ylabel="share of runs above", ylim=(-0.02, 1.02))
        axes.set_xlim(left=float(rows["final_return"].min()))
        reached = rows["final_return"][rows["share"] > 0]
        if ALL_TASKS not in rows["task"].iloc[0]:
            marks.set_returns(axes, rows, 0.0, float(reached.max()), "x")

    note = f"share of runs with a higher final return; {DECIDING_SEEDS} seeds or more; 95% bands"
    panels = by_task(rows, draw, (5.2, 2.8))
    return Chart("profiles", "Performance profiles", note, panels, looks)


def motor(frames: Frames) -> Chart:
    """Returns the distribution of motor velocities of evaluated policies (Figure 4)."""
    looks = style.looks(frames.motor, "label", "label")

    def draw(rows: pd.DataFrame, axes: Axes) -> None:
        for name, line in rows.groupby("label", sort=False):
            density = line["density"].where(line["density"] > 0)  # the axis is logarithmic
            tips = [
                f"{name}: density {value:.2g} at {at * FULL_SPEED:.0f} rad/s"
                for at, value in zip(line["velocity"], density, strict=True)
            ]
            xy = np.column_stack([line["velocity"], density])
            marks.add_line(axes, xy, tips, looks[str(name)], step="mid")

        axes.set(xlabel="motor velocity as observed (1: 180 rad/s)", ylabel="density")
        marks.set_logarithmic(axes, "y")

    panels = by_task(frames.motor, draw, (5.0, 2.8))
    note = "distribution over all states of the evaluated episodes (the paper's Figure 4)"
    return Chart("motor", "Motor velocities", note, panels, looks, columns=2)


def positions(frames: Frames) -> Chart:
    """Returns the positions of the robot with evaluated policies (Figure 5)."""
    note = (
        "share of all states, from light to dark on a logarithmic scale; cross: start; arrow: the "
        "target's direction (the paper's Figure 5)"
    )
    panels = by_task(frames.positions, _draw_positions, (3.4, 3.2), by=["task", "label"])
    return Chart("positions", "Positions", note, panels, minimum=260)


def _draw_positions(rows: pd.DataFrame, axes: Axes) -> None:
    """Draws how often the robot was at each place, and the target."""
    reach, yaw = (float(rows[name].iloc[0]) for name in ("reach", "target_yaw"))
    share = rows.pivot_table(index="y", columns="x", values="share").where(lambda share: share > 0)
    axes.pcolormesh(
        share.columns.to_numpy(float),
        share.index.to_numpy(float),
        share.to_numpy(),
        shading="nearest",
        rasterized=True,
        cmap="viridis_r",
        norm=colors.LogNorm(1e-6, 0.1),
    )
    axes.plot(0, 0, "+", color=_TARGET, markersize=9)
    if np.isfinite(yaw):
        x, y = reach * np.cos(yaw), reach * np.sin(yaw)
        arrow = {"arrowstyle": "->", "color": _TARGET}
        axes.annotate("", (0.85 * x, 0.85 * y), (0.55 * x, 0.55 * y), arrowprops=arrow)

    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x (m)", ylabel="y (m)")
    axes.set_aspect("equal")
