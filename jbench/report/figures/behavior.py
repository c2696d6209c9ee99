"""What policies do: motor velocities and positions (the paper's Figures 4 and 5)."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from jbench.report import style
from jbench.report.figures.chart import Chart, Panel, add_tips, numbers, series
from jbench.report.frames import Frames
from jbench.report.style import Look

_FULL_SPEED = 180  # rad/s, an observed velocity of 1


def motor(frames: Frames) -> Chart | None:
    """Returns the distribution of motor velocities of evaluated policies (Figure 4)."""
    rows = frames.motor
    if rows.empty:
        return None
    names = dict.fromkeys(rows["label"])
    looks = style.algorithm_looks([(name, name) for name in names])
    panels = [
        Panel(str(task), {"": partial(draw_motor, group, looks=looks)}, (5.0, 2.8))
        for task, group in rows.groupby("task", sort=False)
    ]
    note = "distribution over all states of the evaluated episodes (the paper's Figure 4)"
    return Chart("figure4", "Motor velocities", note, panels, "motor", looks, columns=2)


def draw_motor(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the density of motor velocities.

    Args:
        rows: rows of `frames.motor` of one task.
    """
    order = numbers(looks)
    for name, line in rows.groupby("label", sort=False):
        look, number = looks[str(name)], order[str(name)]
        density = line["density"].where(line["density"] > 0).to_numpy()
        velocity = line["velocity"].to_numpy()
        axes.step(
            velocity, density, where="mid", color=look.color, linestyle=look.linestyle,
            gid=series(number),
        )  # fmt: skip
        known = np.isfinite(density)
        tips = [
            f"{name}: density {value:.2g} at {at * _FULL_SPEED:.0f} rad/s"
            for at, value in zip(velocity[known], density[known], strict=True)
        ]
        if known.sum() > 40:
            add_tips(axes, velocity[known], density[known], tips, look, number)
    axes.set(yscale="log", xlabel="motor velocity as observed (1: 180 rad/s)", ylabel="density")


def positions(frames: Frames) -> Chart | None:
    """Returns the positions of the robot with evaluated policies (Figure 5)."""
    rows = frames.positions
    if rows.empty:
        return None
    panels = [
        Panel(f"{label}", {"": partial(draw_positions, group)}, (3.4, 3.2))
        for (_, label), group in rows.groupby(["task", "label"], sort=False)
    ]
    note = (
        "share of all states, from light to dark on a logarithmic scale; cross: start; arrow: the "
        "target's direction (the paper's Figure 5)"
    )
    return Chart("figure5", "Positions", note, panels, "positions", {}, columns=3, minimum=260)


def draw_positions(rows: pd.DataFrame, axes: Axes) -> None:
    """Draws a map of the torso's positions.

    Args:
        rows: rows of `frames.positions` of one policy.
    """
    reach = float(rows["reach"].iloc[0])
    share = rows.pivot_table(index="y", columns="x", values="share").where(lambda cell: cell > 0)
    axes.pcolormesh(
        share.columns.to_numpy(float), share.index.to_numpy(float), share.to_numpy(),
        cmap="viridis_r", norm=LogNorm(1e-6, 0.1), shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.plot(0, 0, "+", color="#d00000", markersize=9)
    yaw = float(rows["target_yaw"].iloc[0])
    if np.isfinite(yaw):
        x, y = reach * np.cos(yaw), reach * np.sin(yaw)
        axes.annotate(
            "", (0.85 * x, 0.85 * y), (0.55 * x, 0.55 * y),
            arrowprops={"arrowstyle": "->", "color": "#d00000"},
        )  # fmt: skip
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x (m)", ylabel="y (m)")
    axes.set_aspect("equal")
