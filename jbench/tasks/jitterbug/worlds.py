"""The simulation of many Jitterbugs."""

import ctypes
import os
from collections.abc import Sequence
from typing import Any
from weakref import WeakSet

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.random import Generator
from numpy.typing import NDArray

from jbench import task_specs
from jbench.task_specs import PHYSICS_STEPS, TASK_SPECS
from jbench.tasks.jitterbug import model as robot
from jbench.tasks.jitterbug import resets
from jbench.tasks.jitterbug.features import features, flatten
from jbench.tasks.jitterbug.geometry import Array, State, Target, heading
from jbench.tasks.jitterbug.rewards import reward, upright_reward
from jbench.tasks.task import Worlds, WorldsState

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
        """Creates the robots at the origin, at rest, upright; `threads` include the caller's."""
        self._model = model
        self._offset = robot.torso_offset(model)
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

    def load(self, index: int, data: mujoco.MjData) -> None:
        """Copies the complete state of one robot into `data`, which is made of the model."""
        mujoco.mj_setState(data.model, data, self._batch.state[index], _STATE)

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how to make a copy, which has threads of its own."""
        return Robots, (self._model, self._batch.nsim, self._threads), self.snapshot()

    def __setstate__(self, snapshot: NDArray[np.float64]) -> None:
        """See `restore`."""
        self.restore(snapshot)

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


class JitterbugWorlds(Worlds):
    """Robots of one of the five tasks, with their state after the last step or reset."""

    robot_state: State
    target: Target

    def __init__(self, task: str, model: mujoco.MjModel, count: int, threads: int) -> None:
        """Has no episode yet; see `reset`."""
        self._task = task
        self._robots = Robots(model, count, threads)
        self.episode_steps = task_specs.EPISODE_STEPS
        self.failures = {}
        self.target = Target(np.zeros((count, 3)), np.zeros(count))

    def reset(
        self, generators: Sequence[Generator], yaw: float | None = None
    ) -> NDArray[np.float32]:
        """Begins an episode in each world, with targets of a yaw (rad) or, if None, as drawn."""
        quaternions, self.target = resets.draw_starts(self._task, generators)
        if yaw is not None:
            self.target = self.target._replace(yaw=np.full(len(quaternions), yaw))
        return self._observe(self._robots.reset(quaternions))

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, 1); see `Worlds.step`."""
        state = self._robots.step(actions[:, 0])
        seen = self._see(state)
        return self._flat(seen), np.asarray(reward(self._task, state, self.target, seen))

    def state(self, rows: slice) -> WorldsState:
        """Returns the complete state of some worlds, at any control step."""
        return {
            "simulation": self._robots.snapshot(rows),
            "target_position": self.target.position[rows].copy(),
            "target_yaw": self.target.yaw[rows].copy(),
        }

    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Restores what `state` returned; the worlds then continue bit for bit."""
        self.target.position[rows] = state["target_position"]
        self.target.yaw[rows] = state["target_yaw"]
        return self._observe(self._robots.restore(state["simulation"], rows))

    def points(self) -> NDArray[np.float32]:
        """Returns x, y (m) and heading (rad) of each robot (worlds, 3)."""
        state = self.robot_state
        points = [state.position[:, 0], state.position[:, 1], heading(state)]
        return np.stack(points, axis=-1).astype(np.float32)

    def robot_columns(self) -> dict[str, NDArray[np.float32]]:
        """Returns the columns of `policy_states` on the robots, each (worlds,)."""
        state = self.robot_state
        columns = {
            **dict(zip("xyz", state.position[:, :3].T, strict=True)),
            "heading": heading(state),
            "upright": upright_reward(state),
            "motor_position": state.motor_position,
            "motor_velocity": state.motor_velocity,
        }
        return {name: np.asarray(values, np.float32) for name, values in columns.items()}

    def targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns x, y (m) and yaw (rad) of the targets, those that the task draws."""
        numbers = resets.target_numbers(self._task, self.target).T
        return dict(zip(TASK_SPECS[self._task].drawn, numbers, strict=True))

    def whole_targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns x, y (m) and yaw (rad) of the targets, also those that are not drawn."""
        position, yaw = self.target
        return {"x": position[:, 0], "y": position[:, 1], "yaw": yaw}

    def _observe(self, state: State) -> NDArray[np.float32]:
        """Returns observations of a new state of the robots."""
        return self._flat(self._see(state))

    def _see(self, state: State) -> dict[str, Array]:
        """Returns the features of a new state of the robots, in SI units."""
        self.robot_state = state
        return features(self._task, state, self.target)

    def _flat(self, seen: dict[str, Array]) -> NDArray[np.float32]:
        return np.asarray(flatten(self._task, seen), np.float32)
