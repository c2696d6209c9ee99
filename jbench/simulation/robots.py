"""Many robots stepped together with actions that depend on what they do, on threads."""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.names import PHYSICS_STEPS
from jbench.tasks import model as robot
from jbench.tasks.features import State


class Robots:
    """A number of robots in a world of their own each, with one batch of states for all.

    Use it as a context manager: it holds threads. The threads do not change the result.
    """

    def __init__(self, model: mujoco.MjModel, count: int, threads: int) -> None:
        """Makes the robots.

        Args:
            model: of every robot.
            count: how many.
            threads: how many of them step at a time.
        """
        self._model = model
        self._offset = robot.torso_offset(model)
        self._datas = [mujoco.MjData(model) for _ in range(count)]
        self._qpos = np.empty((count, model.nq))
        self._qvel = np.empty((count, model.nv))
        self._executor = ThreadPoolExecutor(threads)
        bounds = np.linspace(0, count, min(threads, count) + 1).astype(int)
        self._shares = [range(*pair) for pair in itertools.pairwise(bounds.tolist())]

    def __enter__(self) -> "Robots":
        """Returns itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Ends the threads."""
        self._executor.shutdown()

    def reset(self, quaternions: NDArray[np.float64]) -> State:
        """Puts every robot at the origin, at rest, in its orientation (count, 4)."""
        for i, (data, quaternion) in enumerate(zip(self._datas, quaternions, strict=True)):
            robot.place(data, quaternion)
            self._qpos[i], self._qvel[i] = data.qpos, data.qvel
        return self._state()

    def step(self, actions: NDArray[np.floating]) -> State:
        """Holds the actions (count,), clipped to [-1, 1], for one control step."""
        commands = np.clip(actions, -1, 1).tolist()

        def step_share(share: range) -> None:
            for i in share:
                data = self._datas[i]
                data.ctrl[0] = commands[i]
                mujoco.mj_step(self._model, data, nstep=PHYSICS_STEPS)
                self._qpos[i], self._qvel[i] = data.qpos, data.qvel

        self._each_share(step_share)
        return self._state()

    def _each_share(self, work: Callable[[range], None]) -> None:
        list(self._executor.map(work, self._shares))

    def _state(self) -> State:
        return robot.state_of(self._qpos, self._qvel, self._offset)
