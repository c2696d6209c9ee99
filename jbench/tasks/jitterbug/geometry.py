"""The state of robots and their targets, and the angles, distances and velocities between them.

All functions take numpy or torch arrays with any leading axes (none, robots, time x robots, ...)
and return arrays of the same type. Units are SI (m, s, rad). Quaternions are (w, x, y, z) of unit
length.
"""

import math
from typing import NamedTuple

from jbench.arrays import Array, namespace

TARGET_HEIGHT = 0.035  # height of every target, equal to that of the torso's frame at rest (m)


class State(NamedTuple):
    """The state of robots as used by the tasks, for any leading axes `...`."""

    position: Array  # (..., 7) torso x, y, z in the world (m), then its quaternion
    velocity: Array  # (..., 6) in the world (m/s), then angular in the torso's frame (rad/s)
    motor_position: Array  # (...) motor angle in (-pi, pi]; 0 if the mass points forward (rad)
    motor_velocity: Array  # (...) rad/s
    torso_velocity: Array  # (..., 3) of its center of mass in the world (m/s); None if unread


class Target(NamedTuple):
    """Target position and direction, for any leading axes `...`."""

    position: Array  # (..., 3) in the world (m)
    yaw: Array  # (...) direction of the target's x axis (rad)


def wrap_angle(angle: Array) -> Array:
    """Wraps an angle to (-pi, pi]; angles within (-pi, pi) are returned unchanged."""
    xp = namespace(angle)
    wrapped = angle - 2 * math.pi * xp.ceil((angle - math.pi) / (2 * math.pi))
    # Rounding may leave a wrapped angle slightly outside.
    inside = wrapped.clip(math.nextafter(-math.pi, 0), math.pi)
    return xp.where(xp.abs(angle) < math.pi, angle, inside)


def rotation_matrix(quaternion: Array) -> Array:
    """Returns the (..., 3, 3) rotation matrices of (..., 4) unit quaternions (w, x, y, z)."""
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    # Twice the numbers: products with these need no further factor, and round to the same.
    x2, y2, z2 = x + x, y + y, z + z
    wx, wy, wz = w * x2, w * y2, w * z2
    xx, xy, xz = x * x2, x * y2, x * z2
    yy, yz, zz = y * y2, y * z2, z * z2
    entries = (
        1 - (yy + zz),
        xy - wz,
        xz + wy,
        xy + wz,
        1 - (xx + zz),
        yz - wx,
        xz - wy,
        yz + wx,
        1 - (xx + yy),
    )
    return xp.reshape(xp.stack(entries, axis=-1), (*quaternion.shape[:-1], 3, 3))


def motor_angle(joint_angle: Array) -> Array:
    """Returns the motor angle in (-pi, pi], 0 forward, for the motor joint's position (rad)."""
    return wrap_angle(joint_angle + math.pi / 2)


def center_of_mass_velocity(position: Array, velocity: Array, offset: Array) -> Array:
    """Returns the (..., 3) world velocity of a point of the torso, in its frame (..., 3) (m/s)."""
    x, y, z = (offset[..., i] for i in range(3))
    wx, wy, wz = (velocity[..., 3 + i] for i in range(3))
    xp = namespace(velocity)
    rotational = xp.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=-1)
    return velocity[..., :3] + rotate(rotation_matrix(position[..., 3:7]), rotational)


def heading(state: State) -> Array:
    """Returns the yaw (...) of the robot's forward axis, -y (rad)."""
    xp = namespace(state.position)
    w, x, y, z = (state.position[..., 3 + i] for i in range(4))
    return xp.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)) - math.pi / 2


def angle_to_target(state: State, target: Target) -> Array:
    """Returns the angle (...) in (-pi, pi] from the robot's heading to the target's yaw (rad)."""
    return wrap_angle(target.yaw - heading(state))


def distance_to_target(state: State, target: Target) -> Array:
    """Returns the 3D distance (...) from the torso's frame to the target (m)."""
    xp = namespace(state.position)
    to_target = target.position - state.position[..., :3]
    return xp.sqrt(xp.sum(to_target * to_target, axis=-1))


def target_in_jitterbug_frame(state: State, target: Target) -> Array:
    """Returns the (..., 3) position of the target in the torso's frame (m)."""
    xp = namespace(state.position)
    to_target = target.position - state.position[..., :3]
    return rotate(xp.matrix_transpose(rotation_matrix(state.position[..., 3:7])), to_target)


def speed_in_target_frame(state: State, target: Target) -> Array:
    """Returns the (..., 3) velocity of the torso's center of mass in the target's frame (m/s)."""
    xp = namespace(state.torso_velocity)
    x, y, z = (state.torso_velocity[..., i] for i in range(3))
    cosine = xp.cos(target.yaw)
    sine = xp.sin(target.yaw)
    along = cosine * x + sine * y
    across = cosine * y - sine * x
    return xp.stack([along, across, xp.broadcast_to(z, along.shape)], axis=-1)


def swing_and_twist(quaternion: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Returns the tilt c, a and b, and cosine and sine of the heading h, of unit quaternions.

    In the swing-twist decomposition, (cos(h/2), 0, 0, sin(h/2)) * (c, a, b, 0) is the quaternion or
    its negative, with c >= 0.
    """
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    # The heading is undefined upside down: it is set to 0.
    has_heading = w * w + z * z > 1e-12  # at the precision of float32
    w = xp.where(has_heading, w, 1.0)
    z = xp.where(has_heading, z, 0.0)
    square = w * w + z * z
    c = xp.sqrt(square)
    a = (w * x + z * y) / c
    b = (w * y - z * x) / c
    return c, a, b, (w * w - z * z) / square, 2 * w * z / square


def rotated_in_plane(cosine: Array, sine: Array, x: Array, y: Array) -> list[Array]:
    """Returns the components of a horizontal vector rotated by an angle."""
    return [cosine * x - sine * y, sine * x + cosine * y]


def tilted(c: Array, a: Array, b: Array, vector: Array) -> list[Array]:
    """Returns the components of a vector (..., 3) rotated by the quaternion (c, a, b, 0)."""
    x, y, z = (vector[..., i] for i in range(3))
    # v + 2 c t + 2 u x t with u = (a, b, 0) and t = u x v.
    tx = 2 * b * z
    ty = -2 * a * z
    tz = 2 * (a * y - b * x)
    return [x + c * tx + b * tz, y + c * ty - a * tz, z + c * tz + a * ty - b * tx]


def rotate(matrix: Array, vector: Array) -> Array:
    """Returns the (..., 3) products of (..., 3, 3) matrices with (..., 3) vectors."""
    return (matrix @ vector[..., None])[..., 0]
