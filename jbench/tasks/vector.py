"""The tasks as a Gymnasium vector environment, on robots that several threads step together.

gymnasium.make_vec("Jitterbug/FaceDirection-v0", num_envs=64)
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

from jbench import task_specs
from jbench.cores import cores
from jbench.errors import RequestError
from jbench.names import in_prose
from jbench.tasks.gym import JitterbugEnv, outcome
from jbench.tasks.jitterbug import resets
from jbench.tasks.jitterbug.geometry import State, Target
from jbench.tasks.jitterbug.worlds import Robots

Infos = dict[str, Any]


class JitterbugVectorEnv(
    gymnasium.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]
):
    """Many environments of one task, stepped together.

    For the same seeds, options and actions it returns the same as a `SyncVectorEnv` of as many
    environments, bit for bit. Returned arrays belong to the caller.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared as in Gymnasium
        **JitterbugEnv.metadata,
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
        **settings: Any,
    ) -> None:
        """Initializes the environments.

        Args:
            max_episode_steps: control steps after which an episode is truncated, 1000 by default;
                -1 for never.
            autoreset_mode: when a finished episode is followed by the next, as in `SyncVectorEnv`.
            threads: threads that step the robots, all cores by default; results are the same.
            settings: of every environment, see `JitterbugEnv`.

        Raises:
            ValueError: if an argument is wrong.
        """
        self.closed = True  # gymnasium < 1.4 closes what is deleted, also if it was never made
        modes = self.metadata["render_modes"]
        if settings.get("render_mode") not in (None, *modes):
            raise RequestError(
                f"render_mode {settings['render_mode']!r} is not one of {in_prose(modes)}; "
                "gymnasium.make has more."
            )

        limit = task_specs.EPISODE_STEPS if max_episode_steps is None else max_episode_steps
        threads = cores() if threads is None else threads
        numbers = (num_envs, limit, threads)
        whole = all(isinstance(number, int | np.integer) for number in numbers)
        if not whole or min(num_envs, threads) < 1 or limit < -1 or limit == 0:
            raise RequestError(
                "num_envs, max_episode_steps and threads must be whole numbers of at least 1, not "
                f"{in_prose(map(str, numbers), 'and')}."
            )

        # Never stepped: it has the model and the spaces, and draws.
        self._single = JitterbugEnv(task, **settings)
        self.num_envs = num_envs
        self.render_mode = self._single.render_mode
        self.single_observation_space = self._single.observation_space
        self.single_action_space = self._single.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self._task = task
        self._limit = np.inf if limit == -1 else limit
        self._robots = Robots(self._single.model, num_envs, threads)
        self._random = [seeding.np_random() for _ in range(num_envs)]
        self._targets = Target(np.zeros((num_envs, 3)), np.zeros(num_envs))
        self._elapsed = np.zeros(num_envs, np.int64)
        self._started = self.closed = False

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
            options: {"target": numbers} chooses the target of all environments (n,), or of each
                (num_envs, n), see `JitterbugEnv.reset`; {"reset_mask": mask} (num_envs,) selects
                the environments to reset.

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
        if partial is not None and not self._started:
            raise ResetNeeded("Call reset without reset_mask first.")

        chosen = resets.option_target(self._task, given, self.num_envs)
        count = self.num_envs
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + index for index in range(count)]

        seeds = [None] * count if seed is None else seed
        if np.asarray(seeds, np.object_).shape != (count,):
            raise RequestError(f"seed is a whole number or a list of {count}, not {seed!r}.")

        for index in np.flatnonzero(mask).tolist():
            if seeds[index] is not None:
                self._random[index] = seeding.np_random(seeds[index])

        state = self._restart(mask, chosen)
        observations, _, info = outcome(self._task, state, self._targets)
        self._started = True
        return observations, _infos(info, mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], Infos]:
        """Applies the actions (num_envs, 1) for one control step of 0.01 s.

        Raises:
            RequestError: if the actions are not numbers of that shape; a ValueError.
        """
        if self.closed:
            raise ClosedEnvironmentError("The environments are closed: make new ones.")
        if not self._started:
            raise ResetNeeded("Call reset before step.")
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise ResetNeeded(
                'Episodes have ended: call reset(options={"reset_mask": truncations}) before step.'
            )

        try:
            commands = np.asarray(actions, np.float64)
        except (TypeError, ValueError):
            commands = np.empty(0)

        if commands.shape != (self.num_envs, 1):
            shape = f"({self.num_envs}, 1)"
            raise RequestError(f"actions must be numbers of shape {shape}, not {actions!r}.")

        restarted = self._ended & (self._mode is AutoresetMode.NEXT_STEP)
        state = self._robots.step(commands[:, 0])
        self._elapsed += 1
        if restarted.any():
            state = self._restart(restarted)

        observations, rewards, info = outcome(self._task, state, self._targets)
        rewards[restarted] = 0
        truncations = self._ended
        infos: Infos = {}
        if self._mode is AutoresetMode.SAME_STEP and truncations.any():
            final = np.full(self.num_envs, None, object)
            for index in np.flatnonzero(truncations):
                final[index] = observations[index].copy()
            infos = {"final_obs": final, "final_info": _infos(info, truncations)}
            for key in list(infos):
                infos[f"_{key}"] = truncations.copy()
            state = self._restart(truncations)
            observations, _, info = outcome(self._task, state, self._targets)

        every = np.ones(self.num_envs, np.bool_)
        return observations, rewards, ~every, truncations, infos | _infos(info, every)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns an image (height, width, 3) for each environment in mode "rgb_array"."""
        if self.render_mode is None:
            return None
        pictures = []
        for index, target in enumerate(zip(*self._targets, strict=True)):
            self._robots.load(index, self._single.data)
            self._single.show_target(Target(*target))
            pictures.append(self._single.render())
        return tuple(pictures)

    def close_extras(self, **_: Any) -> None:
        """Closes the renderer; the threads end with the object."""
        self._single.close()

    @property
    def _ended(self) -> NDArray[np.bool_]:
        """Whether each episode (n,) has reached its limit of control steps."""
        ended: NDArray[np.bool_] = self._elapsed >= self._limit
        return ended

    def _restart(self, mask: NDArray[np.bool_], chosen: Target | None = None) -> State:
        """Starts an episode in some environments; returns the state of all."""
        generators = [self._random[index][0] for index in np.flatnonzero(mask)]
        quaternions, targets = resets.draw_starts(self._task, generators)
        if chosen is not None:
            targets = Target(chosen.position[mask], chosen.yaw[mask])
        self._targets.position[mask], self._targets.yaw[mask] = targets
        self._elapsed[mask] = 0
        return self._robots.reset(quaternions, mask)


def _infos(info: Mapping[str, NDArray[Any]], mask: NDArray[np.bool_]) -> Infos:
    """Returns `info` as vector environments do: 0 where an environment has none, with masks."""
    infos: Infos = {}
    for key, values in info.items():
        rows = mask.reshape(-1, *(1,) * (values.ndim - 1))
        infos[key] = values if mask.all() else np.where(rows, values, 0)
        infos[f"_{key}"] = mask.copy()
    return infos
