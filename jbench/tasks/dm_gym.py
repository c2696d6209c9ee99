"""Tasks of other robots as Gymnasium environments.

gymnasium.make("jbench:jbench/dmc-cheetah-run-v0")
"""

from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.names import in_prose
from jbench.tasks.dm_worlds import DmWorlds
from jbench.tasks.find import find_task
from jbench.tasks.pictures import FREE_CAMERA, Artist

FREE = "free"
"""Name of the camera that sees the whole model, which every robot has."""


class SuiteEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One world of a task of dm_control's suite or of another package.

    Observations are the parts of the task's observation, one after another; actions are scaled to
    [-1, 1]. Episodes end as the task's do, and are truncated after its control steps.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as in Gymnasium

    def __init__(
        self,
        task: str,
        render_mode: str | None = None,
        camera: str | None = None,
        width: int = 640,
        height: int = 480,
        augment: int | None = None,
    ) -> None:
        """Makes the environment.

        Args:
            task: see `jbench.tasks.find_task`.
            render_mode: "rgb_array", or None for no pictures.
            camera: name of a camera of the model, or "free" for one that sees all of it; None for
                its first, or the free one if it has none.
            width, height: of a picture, in pixels.
            augment: seed of an augmented robot; only tasks of the Jitterbug have these.

        Raises:
            RequestError: if the task, camera, render mode or robot does not exist; a ValueError.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise RequestError(f"render_mode is rgb_array or None, not {render_mode!r}.")

        robot_task = find_task(task)
        self._given = task, render_mode, camera, width, height, augment
        self.task = task
        self.render_mode = render_mode
        self._is_begun = False
        worlds = robot_task.worlds(1, augment=augment)
        assert isinstance(worlds, DmWorlds)
        self._worlds = worlds
        self._size = (width, height)
        self._artist: Artist | None = None
        shape = (robot_task.observation_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (robot_task.action_size,), np.float32)
        if robot_task.control_timestep:
            self.metadata = {**self.metadata, "render_fps": round(1 / robot_task.control_timestep)}

        self._camera = None if render_mode is None else self._find_camera(camera)

    @property
    def model(self) -> mujoco.MjModel:
        """The robot; a task that is made again for each episode then has another model."""
        return _raw(self._physics().model)

    @property
    def data(self) -> mujoco.MjData:
        """The state of `model`."""
        return _raw(self._physics().data)

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how a copy is made, which is reset before its first step."""
        return _copied, (self._given, self._np_random, self._np_random_seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins an episode."""
        super().reset(seed=seed)
        self._free_artist()  # the next episode may have another model
        observations = self._worlds.reset([self.np_random])
        self._worlds.check()
        self._is_begun = True
        return observations[0].copy(), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Applies the action (action_size,) for one control step.

        Raises a ResetNeeded after the last step of an episode, or before `reset`.
        """
        if np.shape(action) != self.action_space.shape:
            raise RequestError(
                f"The action must have shape {self.action_space.shape}, not {np.shape(action)}."
            )
        if not self._is_begun or self._worlds.are_over():
            raise ResetNeeded("Call reset before step.")

        observations, rewards = self._worlds.step(np.asarray(action)[None])
        self._worlds.check()
        terminated, truncated = bool(self._worlds.terminated[0]), bool(self._worlds.truncated[0])
        return observations[0].copy(), float(rewards[0]), terminated, truncated, {}

    def render(self) -> NDArray[np.uint8] | None:
        """Returns an image (height, width, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        if self._artist is None:
            assert self._camera is not None
            self._artist = Artist(self.model, self.data, self._camera, *self._size)
        return self._artist.draw(self.render_mode)

    def close(self) -> None:
        """Frees what draws and closes the environment."""
        self._free_artist()
        self._worlds.close()

    def _physics(self) -> Any:
        """The MuJoCo physics of the environment, which has one if it can be drawn."""
        physics = getattr(self._worlds.environments[0], "physics", None)
        if physics is None:
            raise RequestError(f"{self.task} has no MuJoCo physics to draw.")
        return physics

    def _free_artist(self) -> None:
        """Frees the renderer."""
        if self._artist is not None:
            self._artist.close()
            self._artist = None

    def _find_camera(self, name: str | None) -> int:
        """Returns the number of a camera; -1 is the free one."""
        cameras = [self.model.camera(i).name for i in range(self.model.ncam)]
        if name is None:
            return 0 if cameras else FREE_CAMERA
        if name in cameras:
            return cameras.index(name)
        if name == FREE:
            return FREE_CAMERA
        raise RequestError(
            f"{self.task} has no camera {name}; it has {in_prose([*cameras, FREE])}."
        )


def _raw(wrapped: Any) -> Any:
    """Returns MuJoCo's own object, which dm_control wraps and Gymnasium does not."""
    return getattr(wrapped, "ptr", wrapped)


def _copied(given: tuple[Any, ...], random: Any, seed: int | None) -> SuiteEnv:
    """Returns a copy of an environment, as `copy` and `pickle` make it."""
    env = SuiteEnv(*given)
    env._np_random = random
    env._np_random_seed = seed
    return env
