"""Simulation of whole episodes with given actions, one episode per task of a thread pool."""

import threading
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.names import PHYSICS_STEPS
from jbench.tasks import model as robot


class Trajectories(NamedTuple):
    """States of robots over whole episodes.

    Attributes:
        qpos: (episodes, steps + 1, 16) joint positions, the first before any action.
        qvel: (episodes, steps + 1, 15) joint velocities.
    """

    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]


def simulate(
    model: mujoco.MjModel,
    quaternions: NDArray[np.float64],
    actions: NDArray[np.floating],
    executor: Executor,
) -> Trajectories:
    """Simulates episodes on the executor's threads; the result does not depend on them.

    Args:
        quaternions: (episodes, 4) orientations at the start.
        actions: (episodes, steps) motor commands in [-1, 1], each applied for a control step.
        executor: thread pool; MuJoCo releases the GIL while it steps.

    Returns:
        The states before the first action and after every action.
    """
    episodes, steps = actions.shape
    trajectories = Trajectories(
        np.empty((episodes, steps + 1, model.nq)), np.empty((episodes, steps + 1, model.nv))
    )

    def run(episode: int) -> None:
        data = _data_of_thread(model)
        robot.place(data, quaternions[episode])
        qpos, qvel = trajectories.qpos[episode], trajectories.qvel[episode]
        qpos[0], qvel[0] = data.qpos, data.qvel
        control, positions, velocities = data.ctrl, data.qpos, data.qvel
        commands: Sequence[float] = actions[episode].tolist()
        for step, command in enumerate(commands, 1):
            control[0] = command
            mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
            qpos[step], qvel[step] = positions, velocities

    list(executor.map(run, range(episodes)))
    return trajectories


# One MjData per thread and model.
_local = threading.local()


def _data_of_thread(model: mujoco.MjModel) -> mujoco.MjData:
    if getattr(_local, "model", None) is not model:
        _local.model, _local.data = model, mujoco.MjData(model)
    data: mujoco.MjData = _local.data
    return data
