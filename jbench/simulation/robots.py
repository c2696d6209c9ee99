"""Multithreaded step-by-step simulation of many robots."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.closing import Closing
from jbench.names import PHYSICS_STEPS
from jbench.tasks import model as robot
from jbench.tasks.features import State

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

    def __init__(
        self, model: mujoco.MjModel | Sequence[mujoco.MjModel], count: int, threads: int
    ) -> None:
        """Creates the robots at the origin, at rest, upright.

        Args:
            model: of all robots, or one per robot; they may differ in numbers, not in structure.
            threads: number of threads, including the caller's.

        Raises:
            ValueError: if the number of models is wrong, or they differ in structure.
        """
        models = list(model) if isinstance(model, Sequence) else [model] * count
        if len(models) != count or len({each.signature for each in models}) > 1:
            raise ValueError(f"{count} robots need one model, or {count} of the same structure.")
        self._datas = [mujoco.MjData(models[0]) for _ in range(max(1, min(threads, count)))]
        self._offset = np.stack([robot.torso_offset(each) for each in models])
        self._rest_states = self._at_rest(models)
        self._states = self._rest_states.copy()
        self._qpos, self._qvel, self._ctrl = (
            self._columns(models[0], part)
            for part in (
                mujoco.mjtState.mjSTATE_QPOS,
                mujoco.mjtState.mjSTATE_QVEL,
                mujoco.mjtState.mjSTATE_CTRL,
            )
        )
        self._robots = list(zip(models, self._states, strict=True))
        self._pool = ThreadPoolExecutor(max(1, len(self._datas) - 1))
        self._pending: Iterator[tuple[mujoco.MjModel, NDArray[np.float64]]] | None = None
        self._futures: list[Future[None]] = []

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
        self._check_idle()
        indices = self._indices_of(robots)
        if np.shape(quaternions) != (len(indices), 4):
            raise ValueError(f"{len(indices)} robots need as many quaternions of 4 numbers.")
        self._states[indices] = self._rest_states[indices]
        self._qpos[indices, 3:7] = quaternions
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Applies actions (count,), clipped to [-1, 1], for one control step."""
        self.start_step(actions)
        return self.finish_step()

    def start_step(self, actions: NDArray[np.floating]) -> None:
        """Starts a `step` on all threads except the caller's.

        With one thread all work is done in `finish_step`.
        """
        self._check_idle()
        self._ctrl[:, 0] = np.clip(actions, -1, 1)
        # The threads share the iterator: `next` of a list iterator is atomic.
        self._pending = iter(self._robots)
        self._futures = [self._pool.submit(self._work, data) for data in self._datas[1:]]

    def finish_step(self) -> State:
        """Completes the step that was started, and returns the state after it."""
        if self._pending is None:
            raise RuntimeError("No step was started.")
        self._work(self._datas[0])
        for future in self._futures:
            future.result()
        self._pending = None
        return self._state()

    def snapshot(self) -> NDArray[np.float64]:
        """Returns the complete state, a row per robot, for `restore`."""
        self._check_idle()
        return self._states.copy()

    def restore(self, snapshot: NDArray[np.float64], robots: Selection | None = None) -> State:
        """Restores robots, which then continue bit for bit.

        Args:
            snapshot: (n, ...) rows of `snapshot`, one per restored robot.
            robots: the robots to restore; all by default.

        Returns:
            The state of all robots.
        """
        self._check_idle()
        indices = self._indices_of(robots)
        shape = (len(indices), self._states.shape[1])
        if np.shape(snapshot) != shape:
            raise ValueError(f"A snapshot must have shape {shape}, not {np.shape(snapshot)}.")
        self._states[indices] = snapshot
        return self._state()

    def load(self, index: int, data: mujoco.MjData) -> None:
        """Copies the complete state of one robot into `data`, which is made of its model."""
        self._check_idle()
        mujoco.mj_setState(data.model, data, self._states[index], _STATE)

    def _work(self, data: mujoco.MjData) -> None:
        """Steps robots that no other thread has taken, one after another."""
        assert self._pending is not None
        for model, row in self._pending:
            mujoco.mj_setState(model, data, row, _STATE)
            mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
            mujoco.mj_getState(model, data, row, _STATE)

    def _at_rest(self, models: Sequence[mujoco.MjModel]) -> NDArray[np.float64]:
        """Returns the state of each robot, upright at rest."""
        rows = np.empty((len(models), mujoco.mj_stateSize(models[0], _STATE)))
        upright = np.array([1.0, 0, 0, 0])
        for model, row in zip(models, rows, strict=True):
            data = mujoco.MjData(model)
            robot.place(data, upright)
            mujoco.mj_getState(model, data, row, _STATE)
        return rows

    def _columns(self, model: mujoco.MjModel, part: Any) -> NDArray[np.float64]:
        """Returns the columns of one part of MuJoCo's state."""
        # The parts are stored in the order of their bits.
        before = mujoco.mj_stateSize(model, _STATE & (part.value - 1))
        return self._states[:, before : before + mujoco.mj_stateSize(model, part.value)]

    def _indices_of(self, robots: Selection | None) -> NDArray[np.integer]:
        """Returns the indices of selected robots."""
        every = np.arange(len(self._states))
        indices: NDArray[np.integer] = every if robots is None else every[np.asarray(robots)]
        return indices

    def _check_idle(self) -> None:
        if self._pending is not None:
            raise RuntimeError("A step is in progress: call finish_step first.")

    def _state(self) -> State:
        return robot.state_of(self._qpos, self._qvel, self._offset)
