"""Many robots stepped together with actions that depend on what they do, on threads."""

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

# All that a step of MuJoCo starts from, its solver's warm start included.
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION.value

Choice = NDArray[np.bool_] | NDArray[np.integer] | Sequence[int]
"""Some of the robots: a mask (count,), or their numbers."""


class Robots(Closing):
    """A number of robots in a world of their own each, with one batch of states for all.

    Use it as a context manager: it holds threads. The threads do not change the result, which is
    that of a loop over robots with a `MjData` each, bit for bit. Every `State` that a method gives
    is a copy: the caller may keep it and change it.

    All of a robot's simulation is a row of one array, and each thread has one `MjData` that takes
    robot after robot through a control step. So it stays in the processor's cache: memory of
    MuJoCo's for every robot costs a tenth of the speed of 256. (`mujoco.rollout` works that way
    too, but gives no warm start back: its next control step would differ in the last bits.)
    """

    def __init__(
        self, model: mujoco.MjModel | Sequence[mujoco.MjModel], count: int, threads: int
    ) -> None:
        """Makes the robots, at the origin, at rest, upright.

        Args:
            model: of every robot, or one for each; they may differ in numbers, not in structure.
            count: how many robots.
            threads: how many of them step at a time, the caller's thread being one of them.

        Raises:
            ValueError: if there are not as many models as robots, or models differ in structure.
        """
        models = list(model) if isinstance(model, Sequence) else [model] * count
        if len(models) != count or len({each.signature for each in models}) > 1:
            raise ValueError(f"{count} robots need one model, or {count} of the same structure.")
        self._datas = [mujoco.MjData(models[0]) for _ in range(max(1, min(threads, count)))]
        self._offset = np.stack([robot.torso_offset(each) for each in models])
        self._fresh = self._at_rest(models)
        self._whole = self._fresh.copy()
        self._qpos, self._qvel, self._ctrl = (
            self._columns(models[0], part)
            for part in (
                mujoco.mjtState.mjSTATE_QPOS,
                mujoco.mjtState.mjSTATE_QVEL,
                mujoco.mjtState.mjSTATE_CTRL,
            )
        )
        self._robots = list(zip(models, self._whole, strict=True))
        self._helpers = ThreadPoolExecutor(max(1, len(self._datas) - 1))
        self._waiting: Iterator[tuple[mujoco.MjModel, NDArray[np.float64]]] | None = None
        self._helping: list[Future[None]] = []

    def close(self) -> None:
        """Ends the threads."""
        self._helpers.shutdown(cancel_futures=True)

    def reset(self, quaternions: NDArray[np.float64], robots: Choice | None = None) -> State:
        """Puts robots at the origin, at rest, each in its orientation.

        Args:
            quaternions: (n, 4) w, x, y, z; one for each of the robots that are reset.
            robots: which; all by default.

        Returns:
            The state of all robots, also of those that go on.
        """
        self._check_still()
        chosen = self._chosen(robots)
        if np.shape(quaternions) != (len(chosen), 4):
            raise ValueError(f"{len(chosen)} robots need as many quaternions of 4 numbers.")
        self._whole[chosen] = self._fresh[chosen]
        self._qpos[chosen, 3:7] = quaternions
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Holds the actions (count,), clipped to [-1, 1], for one control step."""
        self.start_step(actions)
        return self.finish_step()

    def start_step(self, actions: NDArray[np.floating]) -> None:
        """Begins a `step` on all threads but the caller's, which may do something else meanwhile.

        With one thread nothing happens before `finish_step`.
        """
        self._check_still()
        self._ctrl[:, 0] = np.clip(actions, -1, 1)
        # What a thread takes from it, no other gets: a list's iterator is one step of Python.
        self._waiting = iter(self._robots)
        self._helping = [self._helpers.submit(self._work, data) for data in self._datas[1:]]

    def finish_step(self) -> State:
        """Takes part in the step that was begun, and returns the state after it."""
        if self._waiting is None:
            raise RuntimeError("No step was started.")
        self._work(self._datas[0])
        for helper in self._helping:
            helper.result()
        self._waiting = None
        return self._state()

    def snapshot(self) -> NDArray[np.float64]:
        """Returns all of the simulation, a row for each robot: what `restore` goes on from."""
        self._check_still()
        return self._whole.copy()

    def restore(self, snapshot: NDArray[np.float64], robots: Choice | None = None) -> State:
        """Puts robots exactly where they were: what follows is the same, bit for bit.

        Args:
            snapshot: (n, ...) rows of `snapshot`; one for each of the robots that are restored.
            robots: which; all by default.

        Returns:
            The state of all robots.
        """
        self._check_still()
        chosen = self._chosen(robots)
        wanted = (len(chosen), self._whole.shape[1])
        if np.shape(snapshot) != wanted:
            raise ValueError(f"A snapshot of shape {np.shape(snapshot)} can't be put to {wanted}.")
        self._whole[chosen] = snapshot
        return self._state()

    def _work(self, data: mujoco.MjData) -> None:
        """Takes robots that nobody has taken through the control step, one after another."""
        assert self._waiting is not None
        for model, row in self._waiting:
            mujoco.mj_setState(model, data, row, _WHOLE)
            mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
            mujoco.mj_getState(model, data, row, _WHOLE)

    def _at_rest(self, models: Sequence[mujoco.MjModel]) -> NDArray[np.float64]:
        """Returns the simulation of each robot before anything happens, upright."""
        rows = np.empty((len(models), mujoco.mj_stateSize(models[0], _WHOLE)))
        upright = np.array([1.0, 0, 0, 0])
        for model, row in zip(models, rows, strict=True):
            data = mujoco.MjData(model)
            robot.place(data, upright)
            mujoco.mj_getState(model, data, row, _WHOLE)
        return rows

    def _columns(self, model: mujoco.MjModel, part: Any) -> NDArray[np.float64]:
        """Returns the columns of all simulations that hold one part of MuJoCo's state."""
        # The parts follow each other in the order of their bits.
        before = mujoco.mj_stateSize(model, _WHOLE & (part.value - 1))
        return self._whole[:, before : before + mujoco.mj_stateSize(model, part.value)]

    def _chosen(self, robots: Choice | None) -> NDArray[np.integer]:
        """Returns the numbers of some robots."""
        everyone = np.arange(len(self._whole))
        chosen: NDArray[np.integer] = everyone if robots is None else everyone[np.asarray(robots)]
        return chosen

    def _check_still(self) -> None:
        if self._waiting is not None:
            raise RuntimeError("The robots are in a step: finish_step comes first.")

    def _state(self) -> State:
        return robot.state_of(self._qpos, self._qvel, self._offset)
