"""The simulation of Jitterbugs: many in one batch of states, or one in MuJoCo's own data."""

import copy
import ctypes
import os
from functools import cached_property, partial
from typing import Any
from weakref import WeakSet

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug import model as robot
from jbench.tasks.jitterbug.geometry import State
from jbench.tasks.worlds import ModelAndData

# The complete state of a MuJoCo step, including the solver's warm start.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value

Selection = NDArray[np.bool_] | NDArray[np.integer] | list[int] | slice
"""Some of the robots: a mask (count,), indices or a slice."""
_EVERY = slice(None)


class Robots:
    """Robots in separate worlds, with one batch of states, stepped by MuJoCo's threads.

    The result does not depend on the threads: it equals a loop over robots with one `MjData` each,
    bit for bit. Every returned `State` is a copy.

    Attributes:
        count: number of robots.
        axes: leading axes of their states.
    """

    def __init__(
        self, model: mujoco.MjModel, count: int, threads: int, *, has_speed: bool = True
    ) -> None:
        """Creates the robots at the origin, at rest, upright.

        `threads` include the caller's. States have a `torso_velocity` only if `has_speed`.
        """
        self.count = count
        self.axes: tuple[int, ...] = (count,)
        self._model = model
        self._offset = robot.torso_offset(model) if has_speed else None
        self._threads = max(1, min(threads, count))
        data = mujoco.MjData(model)
        robot.place(data, robot.UPRIGHT)
        self._at_rest = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, self._at_rest, _STATE)
        self._start(np.tile(self._at_rest, (count, 1)))
        _live.add(self)

    def _start(self, states: NDArray[np.float64]) -> None:
        """Starts threads that step robots with these states."""
        self._batch = mujoco.batch.Batch(self._model, len(states), self._threads)
        self._batch.state[:] = states
        self._qpos, self._qvel, self._ctrl = map(self._batch.bind, ("qpos", "qvel", "ctrl"))

    def reset(self, quaternions: NDArray[np.float64], robots: Selection = _EVERY) -> State:
        """Resets robots to the origin, at rest, in orientations (n, 4) (w, x, y, z).

        Returns the state of all robots, including the others.
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
        """Restores robots by rows (n, ...) of `snapshot`; they then continue bit for bit.

        Returns the state of all robots, including the others.
        """
        self._batch.state[robots] = snapshot
        return self._state()

    def physics(self, index: int) -> ModelAndData:
        """Returns a copy of the model, and data with the complete state of one robot.

        They are the same objects at each call.
        """
        mujoco.mj_setState(*self._shown, self._batch.state[index], _STATE)
        return self._shown

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how to make a copy, which has threads of its own."""
        make = partial(Robots, has_speed=self._offset is not None)
        return make, (self._model, self.count, self._threads), self.snapshot()

    def __setstate__(self, snapshot: NDArray[np.float64]) -> None:
        """See `restore`."""
        self.restore(snapshot)

    @cached_property
    def _shown(self) -> ModelAndData:
        """What `physics` returns."""
        model = copy.deepcopy(self._model)
        return ModelAndData(model, mujoco.MjData(model))

    def _state(self) -> State:
        """Returns the present state of all robots."""
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


class OneRobot:
    """One robot, stepped in MuJoCo's own data, which others may read and change between two steps.

    It has the methods of `Robots`, and the same bits. Its states have no leading axis, since numpy
    computes an observation faster from numbers than from arrays of one.
    """

    count = 1
    axes: tuple[int, ...] = ()

    def __init__(self, model: mujoco.MjModel, *, has_speed: bool = True) -> None:
        """Creates the robot at the origin, at rest, upright; see `Robots`."""
        self._offset = robot.torso_offset(model) if has_speed else None
        self._physics = ModelAndData(model, mujoco.MjData(model))
        robot.place(self._physics.data, robot.UPRIGHT)

    def reset(self, quaternions: NDArray[np.float64], robots: Selection = _EVERY) -> State:
        """Resets the robot to the origin, at rest, in an orientation (1, 4) (w, x, y, z)."""
        robot.place(self._physics.data, quaternions[0])
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Applies an action (1,), clipped to [-1, 1], for one control step."""
        model, data = self._physics
        data.ctrl[:] = np.clip(actions, -1, 1)
        mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
        return self._state()

    def snapshot(self, robots: Selection = _EVERY) -> NDArray[np.float64]:
        """Returns the complete state (1, size), for `restore`."""
        model, data = self._physics
        state = np.empty((1, mujoco.mj_stateSize(model, _STATE)))
        mujoco.mj_getState(model, data, state[0], _STATE)
        return state

    def restore(self, snapshot: NDArray[np.float64], robots: Selection = _EVERY) -> State:
        """Restores what `snapshot` returned; the robot then continues bit for bit."""
        mujoco.mj_setState(*self._physics, snapshot[0], _STATE)
        return self._state()

    def physics(self, index: int) -> ModelAndData:
        """Returns the model and the data themselves."""
        return self._physics

    def _state(self) -> State:
        """Returns the present state of the robot."""
        data = self._physics.data
        return robot.read_state(data.qpos, data.qvel, self._offset)
