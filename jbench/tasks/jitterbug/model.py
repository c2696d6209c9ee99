"""The robot's MuJoCo model, and the conversion of its state to `State`."""

from functools import cache
from importlib import resources

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.tasks.jitterbug.geometry import State, center_of_mass_velocity, motor_angle

REST_HEIGHT = 0.035  # height of the torso's frame at the start of an episode (m)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])  # orientation (w, x, y, z) of the rest pose, facing -y
MOTOR = -1  # index of the motor joint in qpos and in qvel


@cache
def xml() -> str:
    """Returns the robot's MJCF."""
    return (
        resources.files("jbench.tasks.jitterbug")
        .joinpath("jitterbug.xml")
        .read_text(encoding="utf-8")
    )


def torso_offset(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Returns the (3,) center of mass of the torso in its own frame (m)."""
    return np.array(model.body("jitterbug").ipos)


def read_state(
    qpos: NDArray[np.float64], qvel: NDArray[np.float64], offset: NDArray[np.float64] | None
) -> State:
    """Returns the tasks' `State`, a copy, of robots with these joint positions and velocities.

    They are (..., 16) and (..., 15). `offset` is the torso's center of mass, by `torso_offset`;
    without it, the state has no `torso_velocity`, which takes as long as the rest.
    """
    position = qpos[..., :7].copy()
    velocity = qvel[..., :6].copy()
    torso_velocity = None
    if offset is not None:
        torso_velocity = center_of_mass_velocity(position, velocity, offset)
    return State(
        position=position,
        velocity=velocity,
        motor_position=motor_angle(qpos[..., MOTOR]),
        motor_velocity=qvel[..., MOTOR].copy(),
        torso_velocity=torso_velocity,
    )


def yaw_quaternion(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the (4,) orientation (w, x, y, z) that is turned by an angle () about z (rad)."""
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def place(data: mujoco.MjData, quaternion: NDArray[np.float64]) -> None:
    """Places the robot at the origin, at rest, in an orientation (4,).

    Only the state is set; `mj_step` computes the derived quantities.
    """
    mujoco.mj_resetData(data.model, data)
    data.qpos[2] = REST_HEIGHT
    data.qpos[3:7] = quaternion
