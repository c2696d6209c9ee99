"""What policies do: the paper's Figures 4 and 5, from the states that `jbench evaluate` kept."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.report.data.cells import file_name
from jbench.report.figure import Axis, Figure, HeatMap, Panel, Series, Style, padded
from jbench.store import Record, Results, schema

_COLORS = ("#009e73", "#e69f00", "#0072b2", "#cc79a7")
_REACH = 2.0  # m from the origin; a second of the quickest gait is .14 m
_MOTOR_NOTE = (
    "The distribution of the motor's velocity over all states of the evaluated episodes (the "
    "paper's Figure 4): below as observed, 1 at 180 rad/s, above in rad/s. The axis of the density "
    "is logarithmic."
)
_POSITION_NOTE = (
    "Where the robot was over all states of the evaluated episodes (the paper's Figure 5), from "
    "its start at the cross; the arrow is the target's direction where it was fixed."
)
_SHOWN = 4  # policies in a figure
_START = Series(np.zeros(1), np.zeros(1), Style("#d00000", dash="", marker="+", size=9))


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
            f"{record.path} to make it again."
        ) from None


def figures(all_of_them: Sequence[Behaviour]) -> dict[str, Figure]:
    """Returns Figures 4 and 5 for each task, by file name; none where no states were kept."""
    found = {}
    for task in dict.fromkeys(behaviour.task for behaviour in all_of_them):
        chosen = _telling([b for b in all_of_them if b.task == task])
        found[file_name("figure4", task)] = motor_figure(task, chosen)
        found[file_name("figure5", task)] = position_figure(task, chosen)
    return found


def _telling(of_task: Sequence[Behaviour]) -> list[Behaviour]:
    """Returns the policies to draw, by rising return: the worst, and the best of the others."""
    ranked = sorted(of_task, key=lambda behaviour: behaviour.median)
    return ranked if len(ranked) <= _SHOWN else [ranked[0], *ranked[1 - _SHOWN :]]


def motor_figure(task: str, chosen: Sequence[Behaviour]) -> Figure:
    """Returns the distribution of motor velocities of each policy (paper, Figure 4).

    The lower axis is the observation of the motor's velocity, 1 at 180 rad/s, the upper rad/s.
    """
    # The tasks bring dm_control with them, which most reports do without.
    from jbench.tasks.features import RANGES

    full_speed = RANGES["motor_velocity"][1][0]  # rad/s, an observation of 1
    edges = np.linspace(-1.2, 1.2, 121)
    middles = (edges[:-1] + edges[1:]) / 2
    series = []
    for behaviour, color in zip(chosen, _COLORS, strict=False):
        observed = np.clip(behaviour.motor_velocity / full_speed, edges[0], edges[-1])
        density, _ = np.histogram(observed, edges, density=True)
        series.append(Series(middles, density, Style(color), behaviour.label, edges=edges))
    x = Axis(
        "motor velocity, as observed (1 = 180 rad/s)", padded(edges), opposite=("rad/s", full_speed)
    )
    # Policies that rest have a spike at 0 which would flatten all else.
    densities = np.concatenate([one.y for one in series])
    y = Axis("probability density", padded(densities, log=True), log=True)
    return Figure(f"Motor velocities: {task}", [Panel("", x, y, series)], notes=[_MOTOR_NOTE])


def position_figure(task: str, chosen: Sequence[Behaviour]) -> Figure:
    """Returns where each policy's robots were (paper, Figure 5): a heat map of the torso's place.

    The arrow shows the target's direction where it was fixed; every robot starts at the origin.
    """
    farthest = max(float(np.quantile(np.hypot(b.x, b.y), 0.995)) for b in chosen)
    reach = float(np.clip(farthest * 1.05, 0.1, _REACH))
    panels = [_position_panel(b, reach) for b in chosen]
    return Figure(f"Positions: {task}", panels, notes=[_POSITION_NOTE])


def _position_panel(behaviour: Behaviour, reach: float) -> Panel:
    edges = np.linspace(-reach, reach, 81)
    counts, _, _ = np.histogram2d(behaviour.x, behaviour.y, [edges, edges])
    share = counts.T / max(len(behaviour.x), 1)
    heat_map = HeatMap(
        *(edges, edges, np.where(share > 0, share, np.nan)),
        label="share of all states in a cell (log scale)",
        limits=(1e-6, 0.1),
        log=True,
        is_map=True,
    )
    arrow = None
    if behaviour.target_yaw is not None:
        x, y = reach * np.cos(behaviour.target_yaw), reach * np.sin(behaviour.target_yaw)
        arrow = (0.55 * x, 0.55 * y), (0.85 * x, 0.85 * y)
    return Panel(
        f"{behaviour.policy}\nmedian return {behaviour.median:.0f}, {behaviour.episodes} episodes",
        Axis("x (m)", (-reach, reach)),
        Axis("y (m)", (-reach, reach)),
        [_START],
        heat_map=heat_map,
        arrow=arrow,
    )
