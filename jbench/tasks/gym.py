"""Every task as a Gymnasium environment.

gymnasium.make("jbench:Jitterbug/FaceDirection-v0")
gymnasium.make("jbench:AugmentedJitterbug/FaceDirection-v0", augment=3)
gymnasium.make("jbench:jbench/dmc-cheetah-run-v0")
"""

from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from jbench.closing import closed_on_error
from jbench.errors import RequestError
from jbench.tasks.find import find_task
from jbench.tasks.pictures import Pictures, View
from jbench.tasks.task import Task


class RobotEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One world of a task.

    Observations are those of the task, not clipped; actions are clipped to [-1, 1]. Episodes end as
    the task's do, those of the Jitterbug never: `gymnasium.make` truncates them at 1000 steps. What
    `info` contains and which options `reset` has is the task's; at a reset, its reward terms are
    those of the initial state.

    The world's own `model` and `data` are stepped, so a program may read and change them between
    two steps, and no state is copied.

    Attributes:
        task: name of the task.
        world: the world, with the last state of its robot.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared as in Gymnasium
        "render_modes": ["rgb_array", "human"],
    }

    def __init__(
        self,
        task: str,
        render_mode: str | None = None,
        camera: str | None = None,
        width: int = 640,
        height: int = 480,
        augment: int | None = None,
        vary_masses: bool = False,
    ) -> None:
        """Makes the environment.

        Args:
            task: see `jbench.tasks.find.find_task`.
            render_mode: "rgb_array", "human", or None for no pictures.
            camera: name of a camera of the model, or "free" for one that sees all of it; None for
                `tracking` of the Jitterbug, and another robot's first.
            width: of a picture, in pixels, at least 1; not of one that an environment without
                physics draws itself.
            height: as the width.
            augment: seed of an augmented robot's morphology, or None for the plain robot; only
                tasks of the Jitterbug have these.
            vary_masses: whether to vary the augmented robot's densities and gear as well.

        Raises:
            RequestError: if the task, camera, render mode or robot does not exist; a ValueError.
        """
        robot_task = find_task(task)
        self.task = task
        self.render_mode = render_mode
        self.observation_space, self.action_space = spaces(robot_task)
        self.metadata = {**self.metadata, **frame_rate(robot_task)}
        self.world = robot_task.world(augment, vary_masses=vary_masses)
        view = View(render_mode, camera, width, height)
        modes = self.metadata["render_modes"]
        with closed_on_error(self.world):
            self._pictures = Pictures(robot_task, self.world, view, modes)

    @property
    def model(self) -> mujoco.MjModel:
        """The robot; a task that is made again for each episode then has another model."""
        return self._pictures.physics(0).model

    @property
    def data(self) -> mujoco.MjData:
        """The state of `model`; another one that is assigned is copied into it."""
        return self._pictures.physics(0).data

    @data.setter
    def data(self, data: mujoco.MjData) -> None:
        mujoco.mj_copyData(self.data, self.model, data)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins an episode.

        For the Jitterbug, the options {"target": numbers} choose the target, see
        `resets.target_numbers`; the other random numbers, of this episode and the next ones, stay
        the same.

        Raises:
            RequestError: if an option does not exist or its value is wrong; a ValueError.
        """
        chosen = self.world.read_options(options or {})
        super().reset(seed=seed)
        observations = self.world.begin([0], [self.np_random], chosen)
        self.world.check()
        self._pictures.begin()
        if self.render_mode == "human":
            self.render()

        return observations[0].copy(), self._info()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Applies the action (action_size,) for one control step.

        Raises:
            RequestError: if the action is not finite numbers of that shape; a ValueError.
            ResetNeeded: after the last step of an episode, or before `reset`.
        """
        command = self._command(action)
        if not self.world.has_begun or self.world.are_over():
            raise ResetNeeded("Call reset before step.")

        observations, rewards = self.world.step(command[None])
        self.world.check()
        terminated = bool(self.world.terminated[0])
        truncated = bool(self.world.truncated[0])
        if self.render_mode == "human":
            self.render()

        return observations[0].copy(), float(rewards[0]), terminated, truncated, self._info()

    def render(self) -> Any:
        """Returns an image (height, width, 3) in mode "rgb_array"; otherwise None.

        Raises:
            RequestError: if MUJOCO_GL names no backend and none works, if there is no display for
                "human", or if an environment without physics does not draw itself; a ValueError.
        """
        return self._pictures.draw(0)

    def close(self) -> None:
        """Closes windows, frees the renderer and closes the world."""
        self._pictures.close()
        self.world.close()

    def _command(self, action: Any) -> NDArray[np.float64]:
        """Returns an action as numbers (action_size,), of which a single one may be a scalar."""
        shape = self.action_space.shape
        try:
            command = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            command = np.empty(0)

        if command.shape == () and action is not None:
            command = command.reshape(1)
        if command.shape != shape or not np.isfinite(command).all():
            raise RequestError(
                f"The action must be finite numbers of shape {shape}, not {action!r}."
            )
        return command

    def _info(self) -> dict[str, Any]:
        """Returns the `info` of the present state: arrays, and numbers as floats."""
        return {
            name: values[0] if values.ndim > 1 else float(values[0])
            for name, values in self.world.info().items()
        }


def spaces(task: Task) -> tuple[Space[Any], Space[Any]]:
    """Returns the spaces of the observations and of the actions of a task."""
    observed = Box(-np.inf, np.inf, (task.observation_size,), np.float32)
    return observed, Box(-1, 1, (task.action_size,), np.float32)


def frame_rate(task: Task) -> dict[str, int]:
    """Returns the metadata of the pictures of a task: one in a control step, if that is known."""
    if not task.shown_timestep:
        return {}
    return {"render_fps": round(1 / task.shown_timestep)}


JitterbugEnv = RobotEnv
"""The name in Minari datasets that were exported before one environment served every robot."""
