"""Initial states of episodes: random poses of the robot and random targets."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.arrays import Array
from jbench.errors import RequestError
from jbench.task_specs import TASK_SPECS
from jbench.tasks.jitterbug.geometry import TARGET_HEIGHT, Target
from jbench.wording import in_prose

Random = np.random.Generator | np.random.RandomState  # dm_control uses the latter

_MAX_TILT = 0.025  # x and y components of the rotation axis, whose z component is 1
_TARGET_RADIUS = (0.05, 0.2)  # m


def draw_starts(task: str, generators: Iterable[Random]) -> tuple[NDArray[np.float64], Target]:
    """Draws poses (episodes, 4) and targets, one of each after the other from each generator."""
    starts = [(draw_quaternion(random), *draw_target(task, random)) for random in generators]
    quaternions, positions, yaws = (np.stack(part) for part in zip(*starts, strict=True))
    return quaternions, Target(positions, yaws)


def draw_quaternion(random: Random) -> NDArray[np.float64]:
    """Draws the (4,) orientation at the start of an episode (w, x, y, z).

    It is a rotation by U(0, 2 pi) about an axis (u, v, 1) with u, v ~ U(-0.025, 0.025).
    """
    angle = random.uniform(0, 2 * math.pi)
    u, v = (random.uniform(-_MAX_TILT, _MAX_TILT) for _ in range(2))
    axis = np.array([u, v, 1.0])
    axis /= np.linalg.norm(axis)
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])


def draw_target(task: str, random: Random) -> Target:
    """Draws the target of an episode of a task: position (3,) and yaw ()."""
    drawn = TASK_SPECS[task].drawn
    bearing = 0.0
    radius = 0.0
    yaw = 0.0
    if "x" in drawn:
        bearing = random.uniform(0, 2 * math.pi)
        radius = random.uniform(*_TARGET_RADIUS)
    if "yaw" in drawn:
        yaw = random.uniform(0, 2 * math.pi)

    position = np.array([radius * math.cos(bearing), radius * math.sin(bearing), TARGET_HEIGHT])
    return Target(position, np.float64(yaw))


def target_numbers(task: str, target: Target) -> Array:
    """Returns the (..., n) random numbers of targets, see `TaskSpec.drawn`."""
    yaw = np.asarray(target.yaw)[..., None]
    return np.concatenate([target.position[..., :2], yaw], axis=-1)[..., _drawn(task)]


def _drawn(task: str) -> slice:
    """Returns where the random numbers of a task's targets are among x, y and yaw."""
    names = TASK_SPECS[task].drawn
    first = 0 if "x" in names else 2
    return slice(first, first + len(names))


def option_target(task: str, options: Mapping[str, Any], count: int) -> Target | None:
    """Returns the targets of `count` robots that options of `reset` choose; None if they do not.

    Of {"target": numbers}, the inverse of `target_numbers`, the numbers are (n,) for all robots, or
    (count, n) for each.

    Raises:
        RequestError: if there is another option, the task has no random target, or the numbers are
            not those of a target.
    """
    unknown = sorted(map(str, set(options) - {"target"}))
    if unknown:
        raise RequestError(f"reset has no option {', '.join(unknown)}; it has target.")
    if not options:
        return None

    numbers = options["target"]
    names = TASK_SPECS[task].drawn
    if not names:
        raise RequestError(f"{task} has no target to choose: leave out the option target.")

    shapes = [(len(names),), (count, len(names))]
    try:
        chosen = np.atleast_1d(np.array(numbers, np.float64))
    except (TypeError, ValueError):
        chosen = np.empty(0)

    if chosen.shape not in shapes or not np.isfinite(chosen).all():
        raise RequestError(
            f"The target of {task} is an array ({', '.join(names)}) of finite numbers, of shape "
            f"{in_prose(map(str, shapes))}, not {numbers!r}."
        )

    position = np.zeros((count, 3))
    position[..., _drawn(task)] = chosen
    yaw = np.array(position[..., 2])
    position[..., 2] = TARGET_HEIGHT
    return Target(position, yaw)
