"""Multithreaded simulation of many robots: step by step, or whole episodes."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.closing import Closing
from jbench.names import PHYSICS_STEPS
from jbench.tasks import model as robot
from jbench.tasks.geometry import State

# The complete state of a MuJoCo step, including the solver's warm start.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value

Selection = NDArray[np.bool_] | NDArray[np.integer] | Sequence[int]
"""Some of the robots: a mask (count,) or indices."""


class Robots(Closing):
    """Robots in separate worlds, with one batch of states.

    Use it as a context manager: it holds threads. The result does not depend on the threads: it
    equals a loop over robots with one `MjData` each, bit for bit. Every returned `State` is a copy.

    The complete state of a robot is a row of one array. Each thread has one `MjData`, with which it
    steps one robot after another, so that it stays in the cache; one `MjData` per robot would be a
    tenth slower for 256 robots. (`mujoco.rollout` works the same way, but does not return the warm
    start, so the next control step would differ in the last bits.)
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int) -> None:
        """Creates the robots at the origin, at rest, upright.

        Args:
            threads: number of threads, including the caller's.
        """
        self._model, self._offset = model, robot.torso_offset(model)
        self._datas = [mujoco.MjData(model) for _ in range(max(1, min(threads, count)))]
        self._at_rest = np.empty(mujoco.mj_stateSize(model, _STATE))
        robot.place(self._datas[0], robot.UPRIGHT)
        mujoco.mj_getState(model, self._datas[0], self._at_rest, _STATE)
        self._states = np.tile(self._at_rest, (count, 1))
        self._rows = list(self._states)
        self._qpos, self._qvel, self._ctrl = (
            self._columns(part)
            for part in (
                mujoco.mjtState.mjSTATE_QPOS,
                mujoco.mjtState.mjSTATE_QVEL,
                mujoco.mjtState.mjSTATE_CTRL,
            )
        )
        self._start_threads()

    def _start_threads(self) -> None:
        self._pool, self._process = ThreadPoolExecutor(max(1, len(self._datas) - 1)), os.getpid()

    def close(self) -> None:
        """Stops the threads."""
        self._pool.shutdown(cancel_futures=True)

    def reset(self, quaternions: NDArray[np.float64], robots: Selection | None = None) -> State:
        """Resets robots to the origin, at rest, in given orientations.

        Args:
            quaternions: (n, 4) w, x, y, z; one per reset robot.
            robots: the robots to reset; all by default.

        Returns:
            The state of all robots, including the others.
        """
        indices = self._indices(robots)
        self._states[indices] = self._at_rest
        self._qpos[indices, 3:7] = quaternions
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Applies actions (count,), clipped to [-1, 1], for one control step."""
        if self._process != os.getpid():  # a forked process does not have the threads
            self._start_threads()
        self._ctrl[:, 0] = np.clip(actions, -1, 1)
        # The threads share the iterator: `next` of a list iterator is atomic.
        rows = iter(self._rows)
        others = [self._pool.submit(self._work, data, rows) for data in self._datas[1:]]
        self._work(self._datas[0], rows)
        for other in others:
            other.result()
        return self._state()

    def snapshot(self, robots: Selection | None = None) -> NDArray[np.float64]:
        """Returns the complete state of robots, all by default, a row for each, for `restore`."""
        rows: NDArray[np.float64] = self._states[self._indices(robots)]
        return rows

    def restore(self, snapshot: NDArray[np.float64], robots: Selection | None = None) -> State:
        """Restores robots, which then continue bit for bit.

        Args:
            snapshot: (n, ...) rows of `snapshot`, one per restored robot.
            robots: the robots to restore; all by default.

        Returns:
            The state of all robots.
        """
        indices = self._indices(robots)
        self._states[indices] = snapshot
        return self._state()

    def load(self, index: int, data: mujoco.MjData) -> None:
        """Copies the complete state of one robot into `data`, which is made of the model."""
        mujoco.mj_setState(data.model, data, self._states[index], _STATE)

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how to make a copy, which has threads of its own."""
        return _copy, (self._model, self._states, len(self._datas))

    def _work(self, data: mujoco.MjData, rows: Iterator[NDArray[np.float64]]) -> None:
        """Steps robots that no other thread has taken, one after another."""
        for row in rows:
            mujoco.mj_setState(self._model, data, row, _STATE)
            mujoco.mj_step(self._model, data, nstep=PHYSICS_STEPS)
            mujoco.mj_getState(self._model, data, row, _STATE)

    def _columns(self, part: Any) -> NDArray[np.float64]:
        """Returns the columns of one part of MuJoCo's state."""
        # The parts are stored in the order of their bits.
        before = mujoco.mj_stateSize(self._model, _STATE & (part.value - 1))
        return self._states[:, before : before + mujoco.mj_stateSize(self._model, part.value)]

    def _indices(self, robots: Selection | None) -> NDArray[np.integer]:
        """Returns the indices of selected robots."""
        every = np.arange(len(self._states))
        indices: NDArray[np.integer] = every if robots is None else every[np.asarray(robots)]
        return indices

    def _state(self) -> State:
        return robot.read_state(self._qpos, self._qvel, self._offset)


def _copy(model: mujoco.MjModel, states: NDArray[np.float64], threads: int) -> Robots:
    robots = Robots(model, len(states), threads)
    robots.restore(states)
    return robots


def simulate(
    model: mujoco.MjModel,
    quaternions: NDArray[np.float64],
    actions: NDArray[np.floating],
    executor: Executor,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Simulates episodes on the executor's threads; the result does not depend on them.

    Args:
        quaternions: (episodes, 4) orientations at the start.
        actions: (episodes, steps) motor commands in [-1, 1], each applied for a control step.
        executor: thread pool; MuJoCo releases the GIL while it steps.

    Returns:
        Joint positions (episodes, steps + 1, 16) and velocities (episodes, steps + 1, 15), before
        the first action and after every action.
    """
    episodes, steps = actions.shape
    qpos = np.empty((episodes, steps + 1, model.nq))
    qvel = np.empty((episodes, steps + 1, model.nv))

    def run(episode: int) -> None:
        data = mujoco.MjData(model)
        robot.place(data, quaternions[episode])
        control, position, velocity = data.ctrl, data.qpos, data.qvel
        positions, velocities = qpos[episode], qvel[episode]
        positions[0], velocities[0] = position, velocity
        for step, command in enumerate(actions[episode].tolist(), 1):
            control[0] = command
            mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
            positions[step], velocities[step] = position, velocity

    list(executor.map(run, range(episodes)))
    return qpos, qvel
