"""What policies do: the paper's Figures 4 and 5, from the states that `jbench evaluate` kept."""

from collections.abc import Sequence
from functools import partial
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.report import panels
from jbench.report.cells import file_name
from jbench.store import Record, Results, schema

_COLORS = ("#009e73", "#e69f00", "#0072b2", "#cc79a7")
_REACH = 2.0  # m from the origin; a second of the quickest gait is .14 m
_SMALL = 8
_SHOWN = 4  # policies in a figure


class Behaviour(NamedTuple):
    """The states of one evaluated policy.

    Attributes:
        task: that it did.
        policy: its name.
        median: of the episode returns.
        episodes: how many.
        target_yaw: fixed direction of the target (rad), or None.
        motor_velocity: (states,) rad/s.
        x: (states,) m in the world.
        y: (states,) m in the world.
    """

    task: str
    policy: str
    median: float
    episodes: int
    target_yaw: float | None
    motor_velocity: NDArray[np.float32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]

    @property
    def label(self) -> str:
        """What a figure calls it."""
        return f"{self.policy} (median return {self.median:.0f}, {self.episodes} episodes)"


def behaviours(results: Results, task: str | None = None) -> tuple[list[Behaviour], list[str]]:
    """Returns the newest kept states of each policy, on a task or all, and what can't be read."""
    found: dict[tuple[str, str], Behaviour] = {}
    problems = []
    for record in results.scan("evaluation")[0]:
        settings = record.settings
        if record.status != "finished" or not settings.get("states"):
            continue
        if task is not None and settings.get("task") != task:
            continue
        try:
            behaviour = _behaviour(record)
        except WorkError as error:
            problems.append(str(error))
            continue
        found[behaviour.task, behaviour.policy] = behaviour
    return list(found.values()), problems


def _behaviour(record: Record) -> Behaviour:
    """Reads the states of an evaluation; its manifest may come from a stranger and say anything."""
    states = record.read("policy_states", schema.POLICY_STATES)
    settings, yaw = record.settings, record.settings.get("target_yaw")
    try:
        return Behaviour(
            str(settings["task"]),
            str(settings["policy"]),
            float(record.manifest.summary["median"]),
            int(settings["episodes"]),
            None if yaw is None else float(yaw),
            *(states[name].to_numpy() for name in ("motor_velocity", "x", "y")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise WorkError(
            f"The evaluation {record.id} has settings that can't be ({error}); delete "
            f"{record.path} to make it anew."
        ) from None


def draw(
    all_of_them: Sequence[Behaviour], sheet: panels.Sheet = panels.SCREEN
) -> dict[str, Figure]:
    """Returns Figures 4 and 5 for each task, by file name; none where no states were kept."""
    figures = {}
    for task in dict.fromkeys(behaviour.task for behaviour in all_of_them):
        chosen = _telling([b for b in all_of_them if b.task == task])
        figures[file_name("figure4", task)] = motor_figure(task, chosen, sheet)
        figures[file_name("figure5", task)] = position_figure(task, chosen, sheet)
    return figures


def _telling(of_task: Sequence[Behaviour]) -> list[Behaviour]:
    """Returns the policies to draw, by rising return: the worst, and the best of the others."""
    ranked = sorted(of_task, key=lambda behaviour: behaviour.median)
    return ranked if len(ranked) <= _SHOWN else [ranked[0], *ranked[1 - _SHOWN :]]


def motor_figure(
    task: str, chosen: Sequence[Behaviour], sheet: panels.Sheet = panels.SCREEN
) -> Figure:
    """Returns the distribution of motor velocities of each policy (paper, Figure 4).

    The lower axis is the observation of the motor's velocity, 1 at 180 rad/s, the upper rad/s.
    """
    size = (7.6, 4.8) if sheet.text else (sheet.single.whole_width, sheet.single.height + 1.6)
    figure = Figure(figsize=size, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    # The tasks bring dm_control with them, which most reports do without.
    from jbench.tasks.features import RANGES

    full_speed = RANGES["motor_velocity"][1][0]  # rad/s, an observation of 1
    bins = np.linspace(-1.2, 1.2, 121).tolist()
    for behaviour, color in zip(chosen, _COLORS, strict=False):
        observed = np.clip(behaviour.motor_velocity / full_speed, bins[0], bins[-1])
        axes.hist(
            observed,
            bins,
            density=True,
            histtype="step",
            linewidth=1.5,
            color=color,
            label=_wrapped(behaviour.label, sheet),
        )
    # Policies that rest have a spike at 0 which would flatten all else.
    axes.set_yscale("log")
    axes.set_xlabel("motor velocity, as observed (1 = 180 rad/s)", fontsize=_SMALL)
    axes.set_ylabel("probability density", fontsize=_SMALL)
    upper = axes.secondary_xaxis(
        "top", functions=(partial(np.multiply, full_speed), partial(np.multiply, 1 / full_speed))
    )
    upper.set_xlabel("rad/s", fontsize=_SMALL)
    upper.tick_params(labelsize=_SMALL)
    axes.tick_params(labelsize=_SMALL)
    figure.legend(loc="outside lower center", fontsize=_SMALL, frameon=False)
    if sheet.text:
        title = f"Motor velocities: {task}"
        figure.suptitle(title, fontsize=12, fontweight="bold", parse_math=False)
    return figure


def position_figure(
    task: str, chosen: Sequence[Behaviour], sheet: panels.Sheet = panels.SCREEN
) -> Figure:
    """Returns where each policy's robots were (paper, Figure 5): a heat map of the torso's place.

    The arrow shows the target's direction where it was fixed; every robot starts at the origin.
    """
    columns = len(chosen) if sheet.text else min(len(chosen), 2)
    rows = -(-len(chosen) // columns)
    width = 3.6 * columns + 0.6 if sheet.text else sheet.grid.whole_width
    figure = Figure(
        (width, rows * (width / columns + 0.3) + (0.0 if sheet.text else 0.9)),
        facecolor="white",
        layout="constrained",
    )
    FigureCanvasAgg(figure)
    places = figure.subplots(rows, columns, squeeze=False).ravel()
    for place in places[len(chosen) :]:
        place.set_axis_off()
    farthest = max(float(np.quantile(np.hypot(b.x, b.y), 0.995)) for b in chosen)
    reach = float(np.clip(farthest * 1.05, 0.1, _REACH))
    meshes = [_heat_map(*pair, reach, sheet) for pair in zip(places, chosen, strict=False)]
    place = "right" if sheet.text else "bottom"
    bar = figure.colorbar(meshes[0], ax=list(places), shrink=0.8, location=place)
    bar.set_label("share of all states in a cell (log scale)", fontsize=_SMALL)
    if sheet.text:
        title = f"Positions: {task}"
        figure.suptitle(title, fontsize=12, fontweight="bold", parse_math=False)
    return figure


def _wrapped(text: str, sheet: panels.Sheet, panels_beside: int = 1) -> str:
    """Returns a text in lines that fit a figure for a paper; for a screen as it is."""
    if sheet.text:
        return text
    characters = int(15 * sheet.grid.whole_width / panels_beside) - 8
    return "\n".join(line for part in text.split("\n") for line in wrap(part, characters))


def _heat_map(axes: Axes, behaviour: Behaviour, reach: float, sheet: panels.Sheet) -> QuadMesh:
    edges = np.linspace(-reach, reach, 81)
    counts, _, _ = np.histogram2d(behaviour.x, behaviour.y, [edges, edges])
    share = counts.T / max(len(behaviour.x), 1)
    shown = np.ma.masked_equal(share, 0)
    mesh = axes.pcolormesh(
        *(edges, edges, shown), norm="log", cmap="viridis", vmin=1e-6, vmax=0.1, rasterized=True
    )
    axes.plot(0, 0, marker="+", color="#d00000", markersize=9)
    if behaviour.target_yaw is not None:
        x, y = reach * np.cos(behaviour.target_yaw), reach * np.sin(behaviour.target_yaw)
        arrow = {"arrowstyle": "->", "color": "#d00000", "linewidth": 1.6}
        axes.annotate("", (0.85 * x, 0.85 * y), (0.55 * x, 0.55 * y), arrowprops=arrow)
    title = (
        f"{behaviour.policy}\nmedian return {behaviour.median:.0f}, {behaviour.episodes} episodes"
    )
    title = _wrapped(title, sheet, 2)
    axes.set_title(title, fontsize=_SMALL, loc="left", parse_math=False)
    axes.locator_params(nbins=5)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)", fontsize=_SMALL)
    axes.set_ylabel("y (m)", fontsize=_SMALL)
    axes.tick_params(labelsize=_SMALL)
    return mesh
