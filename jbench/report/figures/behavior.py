"""Behavior of policies: the paper's Figures 4 and 5, from states saved by `jbench evaluate`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.report.data.cells import file_name
from jbench.report.figure import Axis, Figure, HeatMap, Panel, Series, Style, padded
from jbench.store import Record, Results

_COLORS = ("#009e73", "#e69f00", "#0072b2", "#cc79a7")
_REACH = 2.0  # m from the origin; the fastest gait moves 0.14 m in a second
_MOTOR_NOTE = (
    "Distribution of the motor's velocity over all states of the evaluated episodes (the paper's "
    "Figure 4). The lower axis shows it as observed (1 at 180 rad/s), the upper one in rad/s. The "
    "density axis is logarithmic."
)
_POSITION_NOTE = (
    "Positions of the robot over all states of the evaluated episodes (the paper's Figure 5). It "
    "starts at the cross; the arrow is the target's direction, if it was fixed."
)
_SHOWN = 4  # policies in a figure
_START = Series(np.zeros(1), np.zeros(1), Style("#d00000", dash="", marker="+", size=9))


class Behavior(NamedTuple):
    """The states of one evaluated policy.

    Attributes:
        median: median episode return.
        target_yaw: fixed direction of the target (rad), or None.
        motor_velocity: (states,) rad/s.
        x: (states,) m, in world coordinates.
        y: (states,) m, in world coordinates.
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
        """Label in figures."""
        return f"{self.policy} (median return {self.median:.0f}, {self.episodes} episodes)"


def behaviors(results: Results, task: str | None = None) -> tuple[list[Behavior], list[str]]:
    """Returns the newest saved states of each policy and task, and sentences on read errors."""
    newest: dict[tuple[str, str], Behavior] = {}
    problems = []
    for record in results.scan("evaluation")[0]:
        settings = record.settings
        if record.status != "finished" or not settings.get("states"):
            continue
        if task is not None and settings.get("task") != task:
            continue
        try:
            behavior = _behavior(record)
        except WorkError as error:
            problems.append(str(error))
            continue
        newest[behavior.task, behavior.policy] = behavior
    return list(newest.values()), problems


def _behavior(record: Record) -> Behavior:
    """Reads the states of an evaluation, whose manifest is untrusted."""
    states = record.read("policy_states")
    settings, yaw = record.settings, record.settings.get("target_yaw")
    try:
        return Behavior(
            str(settings["task"]),
            str(settings["policy"]),
            float(record.manifest.summary["median"]),
            int(settings["episodes"]),
            None if yaw is None else float(yaw),
            *_columns(states),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise WorkError(
            f"The evaluation {record.id} has invalid settings or states ({error}); delete "
            f"{record.path} to make it again."
        ) from None


def _columns(states: pa.Table) -> list[NDArray[np.float32]]:
    """Returns motor velocities and positions.

    Raises:
        ValueError: if there are none, or some are not finite.
    """
    columns = [states[name].to_numpy() for name in ("motor_velocity", "x", "y")]
    if not (states.num_rows and all(np.isfinite(column).all() for column in columns)):
        raise ValueError("no states, or states that are not finite")
    return columns


def figures(behaviors: Sequence[Behavior]) -> dict[str, Figure]:
    """Returns Figures 4 and 5 for each task with saved states, by file name."""
    by_name = {}
    for task in dict.fromkeys(behavior.task for behavior in behaviors):
        selected = _select_policies([b for b in behaviors if b.task == task])
        by_name[file_name("figure4", task)] = motor_figure(task, selected)
        by_name[file_name("figure5", task)] = position_figure(task, selected)
    return by_name


def _select_policies(behaviors: Sequence[Behavior]) -> list[Behavior]:
    """Returns the policies to draw, by ascending return: the worst, and the best of the others."""
    ranked = sorted(behaviors, key=lambda behavior: behavior.median)
    return ranked if len(ranked) <= _SHOWN else [ranked[0], *ranked[1 - _SHOWN :]]


def motor_figure(task: str, chosen: Sequence[Behavior]) -> Figure:
    """Returns the distribution of motor velocities of each policy (paper, Figure 4).

    The lower axis is the observation of the motor's velocity, 1 at 180 rad/s, the upper rad/s.
    """
    # Imported here because the package imports dm_control, which most reports don't need.
    from jbench.tasks.features import RANGES

    full_speed = RANGES["motor_velocity"][1][0]  # rad/s, an observation of 1
    edges = np.linspace(-1.2, 1.2, 121)
    middles = (edges[:-1] + edges[1:]) / 2
    series = []
    for behavior, color in zip(chosen, _COLORS, strict=False):
        observed = np.clip(behavior.motor_velocity / full_speed, edges[0], edges[-1])
        density, _ = np.histogram(observed, edges, density=True)
        series.append(Series(middles, density, Style(color), behavior.label, edges=edges))
    x = Axis(
        "motor velocity, as observed (1 = 180 rad/s)", padded(edges), opposite=("rad/s", full_speed)
    )
    # Logarithmic, because resting policies have a spike at 0 that would flatten everything else.
    densities = np.concatenate([one.y for one in series])
    y = Axis("probability density", padded(densities, log=True), log=True)
    return Figure(f"Motor velocities: {task}", [Panel("", x, y, series)], notes=[_MOTOR_NOTE])


def position_figure(task: str, chosen: Sequence[Behavior]) -> Figure:
    """Returns a heat map of the torso's position for each policy (paper, Figure 5)."""
    farthest = max(float(np.quantile(np.hypot(b.x, b.y), 0.995)) for b in chosen)
    reach = float(np.clip(farthest * 1.05, 0.1, _REACH))
    panels = [_position_panel(b, reach) for b in chosen]
    return Figure(f"Positions: {task}", panels, notes=[_POSITION_NOTE])


def _position_panel(behavior: Behavior, reach: float) -> Panel:
    edges = np.linspace(-reach, reach, 81)
    counts, _, _ = np.histogram2d(behavior.x, behavior.y, [edges, edges])
    share = counts.T / max(len(behavior.x), 1)
    heat_map = HeatMap(
        edges,
        edges,
        np.where(share > 0, share, np.nan),
        label="share of all states in a cell (log scale)",
        limits=(1e-6, 0.1),
        log=True,
        is_map=True,
    )
    arrow = None
    if behavior.target_yaw is not None:
        x, y = reach * np.cos(behavior.target_yaw), reach * np.sin(behavior.target_yaw)
        arrow = (0.55 * x, 0.55 * y), (0.85 * x, 0.85 * y)
    return Panel(
        f"{behavior.policy}\nmedian return {behavior.median:.0f}, {behavior.episodes} episodes",
        Axis("x (m)", (-reach, reach)),
        Axis("y (m)", (-reach, reach)),
        [_START],
        heat_map=heat_map,
        arrow=arrow,
    )
