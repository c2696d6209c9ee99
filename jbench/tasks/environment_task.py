"""Tasks of environments that others wrote, for `dm_env` or Gymnasium.

They are stepped by the methods of `dm_env.Environment`, which `GymAsDmEnv` adds to those of
Gymnasium.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.settings.specs import Specs
from jbench.sources import checksum
from jbench.tasks.environment_maker import EnvironmentMaker
from jbench.tasks.environment_specification import (
    UnusableError,
    advice_on_limit,
    declared_limit,
    may_end_early,
    measured_limit,
    read_bounds,
    read_parts,
    read_timestep,
)
from jbench.tasks.environment_worlds import EnvironmentWorlds, close
from jbench.tasks.gym_as_dm_env import GymAsDmEnv
from jbench.tasks.own_pictures import mujoco_physics, render_fps
from jbench.tasks.robot_checksum import older_robot_checksum, robot_checksum
from jbench.tasks.task import DOES_NOT_REPEAT, rollout
from jbench.tasks.worlds import Worlds

Make = Callable[[int], Any]
"""Returns a new environment with a seed."""

_SEEDS_TRIED = 10
"""Most seeds whose episodes must have the time limit that was measured."""

_STEPS_TRIED = 20_000
"""Control steps of these episodes, so that trying a task takes seconds."""


class EnvironmentTask(EnvironmentMaker):
    """A task whose environment is a `dm_env.Environment` or a `gymnasium.Env` of others."""

    specs: Specs

    def __init__(
        self,
        name: str,
        make: Make,
        *,
        takes_random: bool = True,
        files: Mapping[str, str] | None = None,
        description: str = "",
        provenance: Callable[[], Mapping[str, Any]] | None = None,
        draw: Make | None = None,
    ) -> None:
        """Makes an environment and reads its specifications: RequestError if it is unusable.

        `draw` makes one whose `render` returns pictures; None if `make` takes no render mode. The
        seed must decide about its random numbers, or `takes_random` is false. `files` are those
        of a user's code, see `source_files`; None for a task of dm_control's suite, which its
        version describes, as does the lack of `provenance`, which returns that of the code.
        """
        self.name = name
        self.description = description
        self._make = make
        self._draw = draw or make
        self._provenance = provenance

        environment = self.environment(0)
        try:
            self._read(environment, files, takes_random)
        except UnusableError as error:
            raise self._refusal(str(error)) from error
        except ERRORS_OF_OTHERS as error:
            raise self._refusal(f"it fails ({sentence_of_failure(error)})") from error
        finally:
            close(name, environment)

    def _read(self, environment: Any, files: Mapping[str, str] | None, takes_random: bool) -> None:
        """Reads what is known of an environment; an UnusableError says why it can't be used."""
        self.parts, self.notes = read_parts(environment)
        if isinstance(environment, GymAsDmEnv):
            self.notes += environment.notes()
        self._bounds = read_bounds(environment)
        self.action_size = len(self._bounds.minimum)
        self.ends_early = may_end_early(environment)
        self.has_state_within_episode = self.ends_early
        self._check_columns()

        is_gymnasium = isinstance(environment, GymAsDmEnv)
        random = getattr(getattr(environment, "task", None), "random", None)
        self.reseeds = is_gymnasium or isinstance(random, np.random.RandomState)
        self.has_one_model = self.reseeds
        self.has_unit_rewards = not is_gymnasium
        if not self.reseeds and not takes_random:
            raise UnusableError(
                "its episodes can't be seeded: give its task a RandomState `random`, or its "
                "factory an argument `random`"
            )

        self.has_physics = mujoco_physics(environment) is not None
        self.render_fps = render_fps(environment)
        self.control_timestep = read_timestep(environment)
        self.episode_steps = self._read_limit(environment)
        self.specs = Specs(
            model=older_robot_checksum(environment),
            parts=list(self.parts),
            sizes=list(self.parts.values()),
            action_minimum=self._bounds.minimum.tolist(),
            action_maximum=self._bounds.maximum.tolist(),
            control_timestep=self.control_timestep,
            compiled=None if files is None else robot_checksum(environment),
            sources=None if files is None else checksum(files),
            episode_steps=self.episode_steps,
            unit_rewards=self.has_unit_rewards,
        )

    def _read_limit(self, environment: Any) -> int:
        """Returns the control steps of the time limit, which are measured if it is not declared."""
        self.limit_advice = None
        declared = declared_limit(environment)
        if declared is not None:
            return declared

        advice = advice_on_limit(self.name, isinstance(environment, GymAsDmEnv))
        self.limit_advice = advice
        return measured_limit(environment, self._bounds, advice)

    @property
    def action_bounds(self) -> NDArray[np.float64]:
        """See `Task.action_bounds`."""
        return np.array([self._bounds.minimum, self._bounds.maximum])

    def environment(self, seed: int, *, draws: bool = False) -> Any:
        """See `EnvironmentMaker.environment`."""
        make = self._draw if draws else self._make
        try:
            environment = make(seed)
        except (RequestError, WorkError):
            raise
        except DependencyNotInstalled as error:
            raise self._refusal(str(error).rstrip(".")) from error
        except ERRORS_OF_OTHERS as error:
            raise self._refusal(f"it can't be made ({sentence_of_failure(error)})") from error

        if isinstance(environment, gymnasium.Env):
            return GymAsDmEnv(environment, seed)

        wanted = ("reset", "step", "observation_spec", "action_spec")
        if not all(callable(getattr(environment, method, None)) for method in wanted):
            raise self._refusal(
                f"it is a {type(environment).__name__}, not a dm_env.Environment or a gymnasium.Env"
            )

        return environment

    def code_provenance(self) -> dict[str, Any]:
        """See `Task.code_provenance`."""
        if self._provenance is None:
            return {}
        made = {f"task_{key}": value for key, value in self._provenance().items()}
        compiled = self.specs.compiled
        return made if compiled is None else {**made, "task_compiled": compiled}

    def reseed(self, environment: Any, seed: int) -> None:
        """Seeds the next episode of an environment."""
        if isinstance(environment, GymAsDmEnv):
            environment.reseed(seed)
        else:
            environment.task.random.seed(seed)

    def worlds(
        self,
        count: int,
        threads: int = 1,
        augment: int | None = None,
        *,
        vary_masses: bool = False,
    ) -> EnvironmentWorlds:
        """Returns new worlds; see `Task.worlds`. They are stepped in the caller's thread."""
        if augment is not None or vary_masses:
            raise self._refusal("it has no augmented robots; leave them out")
        return EnvironmentWorlds(self, count)

    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to the actuators' bounds."""
        return self._bounds.commands(actions)

    @cached_property
    def _has_repeated(self) -> bool:
        """Whether an episode of random actions was the same twice; WorkError if it fails."""
        with self.worlds(1) as worlds:
            once = self._random_episode(worlds)
            again = self._random_episode(worlds)
        return all(map(np.array_equal, once, again))

    def repeats(self) -> bool:
        """See `Task.repeats`; dm_control's suite is not tried."""
        if self._provenance is None:
            return True
        try:
            return self._has_repeated
        except WorkError:  # the work that asks will meet the error itself
            return True

    def check(self) -> None:
        """Runs an episode of random actions twice; notes if it does not repeat.

        An episode that is not as in `Task` is a RequestError. So is a measured time limit that is
        not the one of all episodes, as far as some of other seeds show it, and a function that
        returns one environment again and again.
        """
        self._try_to_make_two()
        try:
            has_repeated = self._has_repeated
            if self.limit_advice is not None:
                self._try_other_seeds()
        except WorkError as error:
            raise RequestError(str(error)) from None
        if not has_repeated:
            self.notes += (DOES_NOT_REPEAT,)

    def _try_to_make_two(self) -> None:
        """Raises a RequestError if a user's function returns the same environment twice."""
        if self._provenance is None:
            return

        worlds = self.worlds(2)
        with worlds:
            # Training and evaluations would step the same episode.
            first, second = (getattr(made, "env", made) for made in worlds.environments)
            if first is second:
                raise self._refusal(
                    "its function returns the same environment again; let it make a new one at "
                    "each call"
                )

    def _try_other_seeds(self) -> None:
        """Makes episodes of other seeds; a WorkError if one can't go on.

        Their commands are those of the episode that was measured, by which it did not terminate.
        """
        episodes = np.clip(_STEPS_TRIED // self.episode_steps, 1, _SEEDS_TRIED)
        actions = np.zeros((1, self.action_size))
        with self.worlds(1) as worlds:
            for seed in range(1, episodes + 1):
                observations = worlds.reset([np.random.default_rng(seed)])
                for _ in rollout(worlds, observations, lambda _: actions):
                    worlds.check()

    def _random_episode(self, worlds: Worlds) -> tuple[NDArray[Any], NDArray[Any]]:
        """Returns what an episode of random actions has.

        These are its observations (steps + 1, size) and its rewards (steps, 1).
        """
        random = np.random.default_rng(0)
        shape = (1, self.action_size)
        seen = [worlds.reset([random])]
        rewards = []
        worlds.check()

        for step in rollout(worlds, seen[0], lambda _: random.uniform(-1, 1, shape)):
            worlds.check()
            seen.append(step.next_observations)
            rewards.append(step.rewards)

        return np.concatenate(seen), np.stack(rewards)

    def _check_columns(self) -> None:
        """Raises an UnusableError if two columns of a dataset would have one name.

        DuckDB ignores upper and lower case.
        """
        first: dict[str, str] = {}
        counts = ("episode", "step")
        ends = ("terminated", "truncated") if self.ends_early else ()
        for column in (*counts, *self.labels, *self.action_labels, "reward", *ends):
            key = column.casefold()
            before = first.get(key)
            if before is None:
                first[key] = column
                continue

            names = f"two columns {column}"
            if before != column:
                names = f"the columns {before} and {column}, which SQL takes for one"
            raise UnusableError(
                f"a dataset of it would have {names}; rename that part of its observation"
            )

    def _refusal(self, reason: str) -> RequestError:
        """Returns the error of an environment that can't be used; the reason is a clause."""
        return RequestError(f"jbench can't use the task {self.name}: {reason}.")
