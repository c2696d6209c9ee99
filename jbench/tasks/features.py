"""Observations of the five tasks, as pure functions on batches of robots.

All functions take numpy or torch arrays with any leading axes (none, robots, time x robots, ...)
and return arrays of the same type. The dm_control task, the Gymnasium environments, the simulation
of many robots and the reader of datasets share them.

Units are SI (m, s, rad). Quaternions are (w, x, y, z) of unit length. The formulas are those of
the paper's tasks (section 4.2) in dm_control's reward conventions (arXiv:1801.00690, section 2).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from array_api_compat import array_namespace

Array = Any
"""A numpy or torch array."""

TARGET_HEIGHT = 0.035
"""Height of every target, equal to that of the torso's frame at rest (m)."""

# Minimum and maximum of each feature, mapped linearly to [-1, 1] in an observation.
_POSITION_RANGE = (
    (-2.0, -2.0, 0.0, -1.0, -1.0, -1.0, -1.0),
    (2.0, 2.0, 0.1, 1.0, 1.0, 1.0, 1.0),
)
_VELOCITY_RANGE = (
    (-1.0, -1.0, -1.0, -35.0, -35.0, -35.0),
    (1.0, 1.0, 1.0, 35.0, 35.0, 35.0),
)
_ANGLE_RANGE = ((-math.pi,), (math.pi,))
RANGES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "position": _POSITION_RANGE,
    "velocity": _VELOCITY_RANGE,
    "motor_position": _ANGLE_RANGE,
    "motor_velocity": ((-180.0,), (180.0,)),
    "angle_to_target": _ANGLE_RANGE,
    "speed_in_target_frame": ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    "target_in_jitterbug_frame": ((-3.0, -3.0, -0.1), (3.0, 3.0, 0.1)),
}
"""Minimum and maximum of each feature, in SI units, one value per dimension."""

FEATURE_SIZES = {name: len(low) for name, (low, _) in RANGES.items()}
"""Number of dimensions of each feature."""

_STATE = ("position", "velocity", "motor_position", "motor_velocity")


class State(NamedTuple):
    """The state of robots as used by the tasks, for any leading axes `...`.

    Attributes:
        position: (..., 7) torso x, y, z in the world (m), then its quaternion.
        velocity: (..., 6) linear velocity of the torso's frame in the world (m/s), then angular
            velocity in the torso's frame (rad/s); like MuJoCo's qvel of a free joint.
        motor_position: (...) motor angle in (-pi, pi]; 0 if the mass points forward (rad).
        motor_velocity: (...) rad/s.
        torso_velocity: (..., 3) velocity of the torso's center of mass in the world (m/s).
    """

    position: Array
    velocity: Array
    motor_position: Array
    motor_velocity: Array
    torso_velocity: Array


class Target(NamedTuple):
    """Target position and direction, for any leading axes `...`.

    Attributes:
        position: (..., 3) in the world (m).
        yaw: (...) direction of the target's x axis (rad).
    """

    position: Array
    yaw: Array


@dataclass(frozen=True)
class TaskSpec:
    """One of the five tasks as data (paper, section 4.2).

    Attributes:
        features: names of the observed features, in the order of the observation.
        rewards: names of the terms whose product is the reward.
        draws_position: whether the target's position is random; otherwise the origin.
        draws_yaw: whether the target's yaw is random; otherwise 0.
    """

    features: tuple[str, ...]
    rewards: tuple[str, ...]
    draws_position: bool = False
    draws_yaw: bool = False

    @property
    def observation_size(self) -> int:
        """Number of dimensions of the flat observation, the paper's dim(O)."""
        return sum(FEATURE_SIZES[name] for name in self.features)

    @property
    def rewards_position(self) -> bool:
        """Whether the reward depends on the robot's position."""
        return not {"near", "away"}.isdisjoint(self.rewards)

    @property
    def target_numbers(self) -> tuple[str, ...]:
        """The numbers of a target that are random, in order: x and y (m), and yaw (rad)."""
        return ("x", "y") * self.draws_position + ("yaw",) * self.draws_yaw


TASK_SPECS = {
    # "away" is what is left of 1 by "near", the target being at the origin.
    "move_from_origin": TaskSpec(_STATE, ("away", "upright")),
    "face_direction": TaskSpec(
        (*_STATE, "angle_to_target"), ("heading", "upright"), draws_yaw=True
    ),
    "move_in_direction": TaskSpec(
        (*_STATE, "angle_to_target", "speed_in_target_frame"),
        ("speed", "upright"),
        draws_yaw=True,
    ),
    "move_to_position": TaskSpec(
        (*_STATE, "target_in_jitterbug_frame"), ("near", "upright"), draws_position=True
    ),
    "move_to_pose": TaskSpec(
        (*_STATE, "target_in_jitterbug_frame", "angle_to_target"),
        ("near", "heading", "upright"),
        draws_position=True,
        draws_yaw=True,
    ),
}
"""The five tasks in the paper's order of increasing difficulty."""


def wrap_angle(angle: Array) -> Array:
    """Wraps an angle to (-pi, pi]; angles within that range are rewrapped exactly."""
    xp = array_namespace(angle)
    wrapped = angle - 2 * math.pi * xp.ceil((angle - math.pi) / (2 * math.pi))
    # Rounding may leave a wrapped angle slightly outside.
    inside = xp.clip(wrapped, math.nextafter(-math.pi, 0), math.pi)
    return xp.where(xp.abs(angle) < math.pi, angle, inside)


def rotation_matrix(quaternion: Array) -> Array:
    """Returns the (..., 3, 3) rotation matrices of (..., 4) unit quaternions (w, x, y, z)."""
    xp = array_namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def motor_angle(joint_angle: Array) -> Array:
    """Returns the motor angle in (-pi, pi], 0 forward, for the motor joint's position (rad)."""
    return wrap_angle(joint_angle + math.pi / 2)


def center_of_mass_velocity(position: Array, velocity: Array, offset: Array) -> Array:
    """Returns the (..., 3) world velocity of a point fixed to the torso (m/s).

    Args:
        position: (..., 7) as in `State`.
        velocity: (..., 6) as in `State`.
        offset: (..., 3) point in the torso's frame, its center of mass (m).
    """
    x, y, z = (offset[..., i] for i in range(3))
    wx, wy, wz = (velocity[..., 3 + i] for i in range(3))
    xp = array_namespace(position, velocity, offset)
    rotational = xp.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=-1)
    return velocity[..., :3] + rotate(rotation_matrix(position[..., 3:7]), rotational)


def heading(state: State) -> Array:
    """Returns the yaw (...) of the robot's forward axis, -y (rad)."""
    xp = array_namespace(state.position)
    w, x, y, z = (state.position[..., 3 + i] for i in range(4))
    return xp.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)) - math.pi / 2


def angle_to_target(state: State, target: Target) -> Array:
    """Returns the angle (...) in (-pi, pi] from the robot's heading to the target's yaw (rad)."""
    return wrap_angle(target.yaw - heading(state))


def distance_to_target(state: State, target: Target) -> Array:
    """Returns the 3D distance (...) from the torso's frame to the target (m)."""
    xp = array_namespace(state.position)
    to_target = target.position - state.position[..., :3]
    return xp.sqrt(xp.sum(to_target * to_target, axis=-1))


def target_in_jitterbug_frame(state: State, target: Target) -> Array:
    """Returns the (..., 3) position of the target in the torso's frame (m)."""
    xp = array_namespace(state.position)
    to_target = target.position - state.position[..., :3]
    return rotate(xp.matrix_transpose(rotation_matrix(state.position[..., 3:7])), to_target)


def speed_in_target_frame(state: State, target: Target) -> Array:
    """Returns the (..., 3) velocity of the torso's center of mass in the target's frame (m/s)."""
    xp = array_namespace(state.torso_velocity)
    x, y, z = (state.torso_velocity[..., i] for i in range(3))
    cosine, sine = xp.cos(target.yaw), xp.sin(target.yaw)
    along, across = cosine * x + sine * y, cosine * y - sine * x
    return xp.stack([along, across, xp.broadcast_to(z, along.shape)], axis=-1)


def features(task: str, state: State, target: Target) -> dict[str, Array]:
    """Returns the features of a task by name, in order, each (..., size) in SI units."""
    values: dict[str, Callable[[], Array]] = {
        "position": lambda: state.position,
        "velocity": lambda: state.velocity,
        "motor_position": lambda: state.motor_position[..., None],
        "motor_velocity": lambda: state.motor_velocity[..., None],
        "angle_to_target": lambda: angle_to_target(state, target)[..., None],
        "speed_in_target_frame": lambda: speed_in_target_frame(state, target),
        "target_in_jitterbug_frame": lambda: target_in_jitterbug_frame(state, target),
    }
    return {name: values[name]() for name in TASK_SPECS[task].features}


def observation(task: str, state: State, target: Target) -> Array:
    """Returns the (..., dim(O)) observation of a task, each feature's range mapped to [-1, 1].

    Observations are not clipped, so features outside their range are outside [-1, 1].

    Args:
        target: with the state's leading axes.
    """
    return flatten(task, features(task, state, target))


def flatten(task: str, values: Mapping[str, Array]) -> Array:
    """Returns the (..., dim(O)) observation that consists of the given `features`."""
    xp = array_namespace(*values.values())
    return normalize(task, xp.concat(list(values.values()), axis=-1))


def split(task: str, flat: Array) -> dict[str, Array]:
    """Returns the features of a task by name, each (..., size), of a flat (..., dim(O)) array."""
    by_name, first = {}, 0
    for name in TASK_SPECS[task].features:
        by_name[name] = flat[..., first : first + FEATURE_SIZES[name]]
        first += FEATURE_SIZES[name]
    return by_name


def normalize(task: str, physical: Array) -> Array:
    """Maps (..., dim(O)) features in SI units to the [-1, 1] of an observation."""
    low, high = _feature_range(task, physical)
    return 2 * (physical - low) / (high - low) - 1


def denormalize(task: str, observed: Array) -> Array:
    """Maps a (..., dim(O)) observation back to its features in SI units."""
    low, high = _feature_range(task, observed)
    return low + (observed + 1) * (high - low) / 2


def feature_range(task: str) -> tuple[list[float], list[float]]:
    """Returns minimum and maximum of each dimension in SI units, mapped to -1 and 1."""
    names = TASK_SPECS[task].features
    return [v for n in names for v in RANGES[n][0]], [v for n in names for v in RANGES[n][1]]


def _feature_range(task: str, like: Array) -> tuple[Array, Array]:
    """Returns minimum and maximum of each dimension, as arrays of the same type as `like`."""
    key = (task, array_namespace(like).__name__, like.dtype, getattr(like, "device", None))
    if key not in _range_cache:
        xp = array_namespace(like)
        options: dict[str, Any] = {"dtype": like.dtype, "device": getattr(like, "device", None)}
        low, high = feature_range(task)
        _range_cache[key] = (xp.asarray(low, **options), xp.asarray(high, **options))
    return _range_cache[key]


# Ranges as arrays, cached per array type, since they are needed at every control step.
_range_cache: dict[tuple[Any, ...], tuple[Array, Array]] = {}


def rotate(matrix: Array, vector: Array) -> Array:
    """Returns the (..., 3) products of (..., 3, 3) matrices with (..., 3) vectors."""
    return (matrix @ vector[..., None])[..., 0]
