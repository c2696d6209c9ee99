"""Multithreaded simulation of many robots."""

import ctypes
import os
from typing import Any
from weakref import WeakSet

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from jbench.names import PHYSICS_STEPS
from jbench.tasks import model as robot
from jbench.tasks.geometry import State

# The complete state of a MuJoCo step, including the solver's warm start.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value

Selection = NDArray[np.bool_] | NDArray[np.integer] | list[int] | slice
"""Some of the robots: a mask (count,), indices or a slice."""
_EVERY = slice(None)


class Robots:
    """Robots in separate worlds, with one batch of states, stepped by MuJoCo's threads.

    The result does not depend on the threads: it equals a loop over robots with one `MjData` each,
    bit for bit. Every returned `State` is a copy.
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int) -> None:
        """Creates the robots at the origin, at rest, upright.

        Args:
            threads: number of threads, including the caller's.
        """
        self._model, self._offset = model, robot.torso_offset(model)
        self._threads = max(1, min(threads, count))
        data = mujoco.MjData(model)
        robot.place(data, robot.UPRIGHT)
        self._at_rest = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, self._at_rest, _STATE)
        self._start(np.tile(self._at_rest, (count, 1)))
        _live.add(self)

    def _start(self, states: NDArray[np.float64]) -> None:
        """Starts threads that step robots with these states."""
        self._batch = Batch(self._model, len(states), self._threads)
        self._batch.state[:] = states
        self._qpos, self._qvel, self._ctrl = map(self._batch.bind, ("qpos", "qvel", "ctrl"))

    def reset(self, quaternions: NDArray[np.float64], robots: Selection = _EVERY) -> State:
        """Resets robots to the origin, at rest, in given orientations.

        Args:
            quaternions: (n, 4) w, x, y, z; one per reset robot.
            robots: the robots to reset; all by default.

        Returns:
            The state of all robots, including the others.
        """
        self._batch.state[robots] = self._at_rest
        self._qpos[robots, 3:7] = quaternions
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Applies actions (count,), clipped to [-1, 1], for one control step."""
        self._ctrl[:, 0] = np.clip(actions, -1, 1)
        self._batch.step(nstep=PHYSICS_STEPS)
        return self._state()

    def snapshot(self, robots: Selection = _EVERY) -> NDArray[np.float64]:
        """Returns the complete state of robots, all by default, a row for each, for `restore`."""
        rows: NDArray[np.float64] = self._batch.state[robots].copy()
        return rows

    def restore(self, snapshot: NDArray[np.float64], robots: Selection = _EVERY) -> State:
        """Restores robots, which then continue bit for bit.

        Args:
            snapshot: (n, ...) rows of `snapshot`, one per restored robot.
            robots: the robots to restore; all by default.

        Returns:
            The state of all robots.
        """
        self._batch.state[robots] = snapshot
        return self._state()

    def load(self, index: int, data: mujoco.MjData) -> None:
        """Copies the complete state of one robot into `data`, which is made of the model."""
        mujoco.mj_setState(data.model, data, self._batch.state[index], _STATE)

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how to make a copy, which has threads of its own."""
        return Robots, (self._model, self._batch.nsim, self._threads), self.snapshot()

    def __setstate__(self, snapshot: NDArray[np.float64]) -> None:
        self.restore(snapshot)

    def _state(self) -> State:
        return robot.read_state(self._qpos, self._qvel, self._offset)


_live: WeakSet[Robots] = WeakSet()


def _restart_threads() -> None:
    """Starts the threads of all robots again in a forked process, which does not have them."""
    for robots in _live:
        # MuJoCo would wait for the end of the old threads before it frees them.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(robots._batch._b))
        robots._start(robots._batch.state)


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_restart_threads)
