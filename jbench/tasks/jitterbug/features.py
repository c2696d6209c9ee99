"""Observations of the five tasks, as pure functions on batches of robots.

The dm_control task, the Gymnasium environments, the simulation of many robots and the reader of
datasets share them. Arrays and units are those of `geometry`. The formulas are those of the paper's
tasks (section 4.2) in dm_control's reward conventions (arXiv:1801.00690, section 2).
"""

import itertools
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.arrays import Array, namespace
from jbench.task_specs import TASK_SPECS
from jbench.tasks.jitterbug import geometry
from jbench.tasks.jitterbug.geometry import State, Target
from jbench.wording import padded


class Feature(NamedTuple):
    """An observed quantity. All but `value` have an entry for each of its dimensions."""

    value: Callable[[State, Target], Array]  # returns it (..., size) in SI units
    axes: tuple[str, ...]  # names; "" for the only one
    units: tuple[str, ...]  # SI units; 1 for quaternions
    low: tuple[float, ...]  # minimum, mapped to -1 in an observation
    high: tuple[float, ...]  # maximum, mapped to 1
    mirror: tuple[int, ...]  # factors 1 or -1 by which the mirrored robot has it

    @property
    def size(self) -> int:
        """Number of dimensions."""
        return len(self.axes)


_POINT = ("x", "y", "z")


def _number(value: Callable[[State, Target], Array], unit: str, high: float) -> Feature:
    """Returns a feature of one number, which changes its sign in the mirror."""
    return Feature(
        value=lambda state, target: value(state, target)[..., None],
        axes=("",),
        units=(unit,),
        low=(-high,),
        high=(high,),
        mirror=(-1,),
    )


FEATURES = {
    "position": Feature(
        value=lambda state, target: state.position,
        axes=(*_POINT, "qw", "qx", "qy", "qz"),
        units=("m",) * 3 + ("1",) * 4,
        low=(-2.0, -2.0, 0.0, -1.0, -1.0, -1.0, -1.0),
        high=(2.0, 2.0, 0.1, 1.0, 1.0, 1.0, 1.0),
        # The reflected orientation is (w, x, -y, -z), or (-w, -x, y, z), which is the same.
        # Episodes start with z >= 0, so only the second one is where the robot could have been.
        mirror=(-1, 1, 1, -1, -1, 1, 1),
    ),
    "velocity": Feature(
        value=lambda state, target: state.velocity,
        axes=(*_POINT, "angular_x", "angular_y", "angular_z"),
        units=("m/s",) * 3 + ("rad/s",) * 3,
        low=(-1.0,) * 3 + (-35.0,) * 3,
        high=(1.0,) * 3 + (35.0,) * 3,
        # An angular velocity is an axial vector: in the mirror's plane it changes its sign.
        mirror=(-1, 1, 1, 1, -1, -1),
    ),
    "motor_position": _number(lambda state, target: state.motor_position, "rad", math.pi),
    "motor_velocity": _number(lambda state, target: state.motor_velocity, "rad/s", 180.0),
    "angle_to_target": _number(geometry.angle_to_target, "rad", math.pi),
    "speed_in_target_frame": Feature(
        value=geometry.speed_in_target_frame,
        axes=_POINT,
        units=("m/s",) * 3,
        low=(-1.0,) * 3,
        high=(1.0,) * 3,
        mirror=(1, -1, 1),
    ),
    "target_in_jitterbug_frame": Feature(
        value=geometry.target_in_jitterbug_frame,
        axes=_POINT,
        units=("m",) * 3,
        low=(-3.0, -3.0, -0.1),
        high=(3.0, 3.0, 0.1),
        mirror=(-1, 1, 1),
    ),
}


def observation_size(task: str) -> int:
    """Returns the number of dimensions of the flat observation of a task, the paper's dim(O)."""
    return sum(FEATURES[name].size for name in TASK_SPECS[task].features)


def features(task: str, state: State, target: Target) -> dict[str, Array]:
    """Returns the features of a task by name, in order, each (..., size) in SI units."""
    return {name: FEATURES[name].value(state, target) for name in TASK_SPECS[task].features}


def by_dimension(task: str, attribute: str) -> list[Any]:
    """Returns an attribute of `Feature`, such as "units", for each dimension of an observation."""
    values = (getattr(FEATURES[name], attribute) for name in TASK_SPECS[task].features)
    return list(itertools.chain.from_iterable(values))


def observation(task: str, state: State, target: Target) -> Array:
    """Returns the (..., dim(O)) observation of a task, each feature's range mapped to [-1, 1].

    Observations are not clipped, so features outside their range are outside [-1, 1].
    """
    return flatten(task, features(task, state, target))


def flatten(task: str, values: Mapping[str, Array]) -> Array:
    """Returns the (..., dim(O)) observation that consists of the given `features`."""
    xp = namespace(next(iter(values.values())))
    return normalize(task, xp.concat(list(values.values()), axis=-1))


def split(task: str, flat: Array) -> dict[str, Array]:
    """Returns the features of a task by name, each (..., size), of a flat (..., dim(O)) array."""
    by_name = {}
    first = 0
    for name in TASK_SPECS[task].features:
        by_name[name] = flat[..., first : first + FEATURES[name].size]
        first += FEATURES[name].size
    return by_name


def mirrored(task: str, flat: Array) -> Array:
    """Returns the observation (..., dim(O)) of the mirrored robot and its mirrored target.

    They are reflected at the world's plane x = 0. The mirror image of a robot that makes the
    negated actions moves as the image of the robot, and every task's reward is the same: x and -x
    are the robot's left and right at heading 0, where legs 1 and 4, and legs 2 and 3, change
    places. `docs/encoders.md` has the accuracy of the simulator.
    """
    xp = namespace(flat)
    device = getattr(flat, "device", None)
    return flat * xp.asarray(by_dimension(task, "mirror"), dtype=flat.dtype, device=device)


def normalize(task: str, physical: Array) -> Array:
    """Maps (..., dim(O)) features in SI units to the [-1, 1] of an observation."""
    low, extent = _feature_range(task, physical)
    return 2 * (physical - low) / extent - 1


def denormalize(task: str, observed: Array) -> Array:
    """Maps a (..., dim(O)) observation back to its features in SI units."""
    low, extent = _feature_range(task, observed)
    return low + (observed + 1) * extent / 2


def _feature_range(task: str, like: Array) -> list[Array]:
    """Returns the lowest features and the extents of their ranges, in the type of an array."""
    return _range(task, namespace(like), like.dtype, getattr(like, "device", None))


@cache  # they are needed at every control step
def _range(task: str, xp: Any, dtype: Any, device: Any) -> list[Array]:
    """Returns the features' ranges as `_feature_range` does, made once for each type."""
    low, high = (
        xp.asarray(by_dimension(task, end), dtype=dtype, device=device) for end in ("low", "high")
    )
    return [low, high - low]


def goal(task: str, observation: NDArray[np.floating]) -> str:
    """Describes the remaining distance and angle to the goal of an observation (dim(O),).

    Distances are horizontal. Numbers are padded with figure spaces to a fixed width.
    """
    by_name = split(task, denormalize(task, np.asarray(observation, np.float64)))
    if task == "move_from_origin":
        return f"{_centimeters(by_name['position'])} from the origin"
    if task == "move_in_direction":
        speed = 100 * by_name["speed_in_target_frame"][0]
        return f"{padded(f'{speed:.1f}', 5)} cm/s as the target points"

    words = []
    if "target_in_jitterbug_frame" in by_name:
        words.append(f"target {_centimeters(by_name['target_in_jitterbug_frame'])} away")
    if "angle_to_target" in by_name:
        angle = math.degrees(by_name["angle_to_target"][0])
        side = "left" if angle > 0 else "right"
        words.append(f"turn {padded(f'{abs(angle):.0f}', 3)}° {side}")

    return ", ".join(words)


def _centimeters(vector: NDArray[np.float64]) -> str:
    """Returns the horizontal length of a vector in cm."""
    return f"{padded(f'{100 * math.hypot(vector[0], vector[1]):.1f}', 4)} cm"
