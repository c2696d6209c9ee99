"""Every task as a Gymnasium vector environment, on robots that are stepped together.

gymnasium.make_vec("jbench:Jitterbug/FaceDirection-v0", num_envs=64)
gymnasium.make_vec("jbench:jbench/dmc-cheetah-run-v0", num_envs=64)
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from jbench.closing import closed_on_error
from jbench.cores import cores
from jbench.errors import RequestError
from jbench.tasks.find import find_task
from jbench.tasks.gym import frame_rate, spaces
from jbench.tasks.pictures import Pictures, View
from jbench.tasks.worlds import Chosen
from jbench.wording import in_prose

Infos = dict[str, Any]


class RobotVectorEnv(
    gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]
):
    """Many environments of one task, stepped together.

    For the same seeds, options and actions it returns the same as a `SyncVectorEnv` of as many
    environments, bit for bit. Returned arrays belong to the caller.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared as in Gymnasium
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        *,
        render_mode: str | None = None,
        augment: int | None = None,
        vary_masses: bool = False,
        **view: Any,
    ) -> None:
        """Initializes the environments.

        Args:
            task: see `jbench.tasks.find.find_task`.
            num_envs: number of environments.
            max_episode_steps: control steps after which an episode is truncated, those of the task
                by default; -1 for never, if the task itself never does.
            autoreset_mode: when a finished episode is followed by the next, as in `SyncVectorEnv`.
            threads: threads that step the Jitterbug, all cores by default; results are the same.
                Robots of other packages are stepped in the caller's.
            render_mode: "rgb_array", or None for no pictures.
            augment: seed of an augmented robot's morphology, see `RobotEnv`.
            vary_masses: whether to vary its densities and gear as well.
            view: camera, width and height, see `RobotEnv`.

        Raises:
            ValueError: if an argument is wrong.
        """
        self.closed = True  # gymnasium < 1.4 closes what is deleted, also if it was never made
        robot_task = find_task(task)
        limit = robot_task.episode_steps if max_episode_steps is None else max_episode_steps
        threads = cores() if threads is None else threads
        numbers = (num_envs, limit, threads)
        whole = all(isinstance(number, int | np.integer) for number in numbers)
        if not whole or min(num_envs, threads) < 1 or limit < -1 or limit == 0:
            raise RequestError(
                "num_envs, max_episode_steps (-1 for no limit) and threads must be whole numbers "
                f"of at least 1, not {in_prose(map(str, numbers), 'and')}."
            )

        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space, self.single_action_space = spaces(robot_task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            **self.metadata,
            **frame_rate(robot_task),
            "autoreset_mode": self._mode,
        }
        self._worlds = robot_task.worlds(num_envs, threads, augment, vary_masses=vary_masses)
        modes = self.metadata["render_modes"]
        with closed_on_error(self._worlds):
            self._pictures = Pictures(robot_task, self._worlds, View(render_mode, **view), modes)
        self._limit = np.inf if limit == -1 else limit
        self._random = [seeding.np_random() for _ in range(num_envs)]
        self._elapsed = np.zeros(num_envs, np.int64)
        self._ended = np.zeros(num_envs, np.bool_)
        self.closed = False

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment."""
        return tuple(generator for generator, _ in self._random)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each generator."""
        return tuple(seed for _, seed in self._random)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], Infos]:
        """Starts an episode in every environment.

        Args:
            seed: of the first environment, the next ones counting up; or a seed for each.
            options: {"reset_mask": mask} (num_envs,) selects the environments to reset. Of the
                Jitterbug, {"target": numbers} chooses the target of all environments (n,), or of
                each (num_envs, n), see `RobotEnv.reset`.

        Raises:
            RequestError: if an option does not exist or its value is wrong; a ValueError.
        """
        given = dict(options or {})
        partial = given.pop("reset_mask", None)
        mask = np.ones(self.num_envs, np.bool_) if partial is None else np.asarray(partial)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise RequestError(
                f"reset_mask is an array of {self.num_envs} booleans, at least one of them True."
            )
        if partial is not None and not self._worlds.has_begun:
            raise ResetNeeded("Call reset without reset_mask first.")

        chosen = self._worlds.read_options(given)
        count = self.num_envs
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + index for index in range(count)]

        seeds = [None] * count if seed is None else seed
        if np.asarray(seeds, np.object_).shape != (count,):
            raise RequestError(f"seed is a whole number or a list of {count}, not {seed!r}.")

        for index in np.flatnonzero(mask).tolist():
            if seeds[index] is not None:
                self._random[index] = seeding.np_random(seeds[index])

        observations = self._begin(mask, chosen)
        return observations, _infos(self._worlds.info(), mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], Infos]:
        """Applies the actions (num_envs, action_size) for one control step.

        Raises:
            RequestError: if the actions are not finite numbers of that shape; a ValueError.
        """
        commands = self._commands(actions)
        restarted = self._ended & (self._mode is AutoresetMode.NEXT_STEP)
        observations, rewards = self._worlds.step(commands)
        self._elapsed += 1
        if restarted.any():
            observations = self._begin(restarted)
            rewards[restarted] = 0

        self._worlds.check()
        terminations = self._worlds.terminated.copy()
        truncations = self._worlds.truncated | (self._elapsed >= self._limit)
        ended = self._ended = terminations | truncations
        infos: Infos = {}
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            final = np.full(self.num_envs, None, object)
            for index in np.flatnonzero(ended):
                final[index] = observations[index].copy()

            infos = {"final_obs": final, "final_info": _infos(self._worlds.info(), ended)}
            for key in list(infos):
                infos[f"_{key}"] = ended.copy()
            observations = self._begin(ended)

        every = np.ones(self.num_envs, np.bool_)
        infos |= _infos(self._worlds.info(), every)
        return observations.copy(), rewards, terminations, truncations, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns an image (height, width, 3) for each environment in mode "rgb_array"."""
        if self.render_mode is None:
            return None
        drawn = (self._pictures.draw(world) for world in range(self.num_envs))
        return tuple(picture for picture in drawn if picture is not None)

    def close_extras(self, **_: Any) -> None:
        """Frees what draws, and closes the worlds."""
        self._pictures.close()
        self._worlds.close()

    def _commands(self, actions: Any) -> NDArray[np.float64]:
        """Returns actions as numbers (num_envs, action_size), if a step is possible now."""
        if self.closed:
            raise ClosedEnvironmentError("The environments are closed: make new ones.")
        if not self._worlds.has_begun:
            raise ResetNeeded("Call reset before step.")
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise ResetNeeded(
                "Episodes have ended: call reset with the options "
                '{"reset_mask": terminations | truncations} before step.'
            )

        try:
            commands = np.asarray(actions, np.float64)
        except (TypeError, ValueError):
            commands = np.empty(0)

        shape = self.action_space.shape
        if commands.shape != shape or not np.isfinite(commands).all():
            raise RequestError(f"actions must be finite numbers of shape {shape}, not {actions!r}.")
        return commands

    def _begin(self, mask: NDArray[np.bool_], chosen: Chosen | None = None) -> NDArray[np.float32]:
        """Begins an episode in some environments; returns the observations of all."""
        indices = np.flatnonzero(mask).tolist()
        generators = [self._random[index][0] for index in indices]
        observations = self._worlds.begin(indices, generators, chosen)
        self._worlds.check()
        self._pictures.begin()
        self._elapsed[mask] = 0
        self._ended = self._ended & ~mask
        return observations.copy()


def _infos(info: Mapping[str, NDArray[Any]], mask: NDArray[np.bool_]) -> Infos:
    """Returns `info` as vector environments do: 0 where an environment has none, with masks."""
    infos: Infos = {}
    for key, values in info.items():
        rows = mask.reshape(-1, *(1,) * (values.ndim - 1))
        infos[key] = values if mask.all() else np.where(rows, values, 0)
        infos[f"_{key}"] = mask.copy()
    return infos


JitterbugVectorEnv = RobotVectorEnv
"""The name in Minari datasets that were exported before one environment served every robot."""
