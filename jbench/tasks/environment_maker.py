"""Tasks that make environments of others, and know what these say of themselves.

The environments are for `dm_env` or Gymnasium. They are stepped by the methods of
`dm_env.Environment`, which `GymAsDmEnv` adds to those of Gymnasium.
"""

import warnings
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from jbench.errors import (
    ERRORS_OF_OTHERS,
    RequestError,
    WorkError,
    WorkWarning,
    sentence_of_failure,
)
from jbench.settings.specs import Specs
from jbench.sources import checksum
from jbench.tasks.environment_specification import (
    UnusableError,
    advice_on_limit,
    advice_on_seeds,
    declared_limit,
    may_end_early,
    measured_limit,
    read_bounds,
    read_parts,
    read_timestep,
)
from jbench.tasks.gym_as_dm_env import GymAsDmEnv
from jbench.tasks.own_pictures import mujoco_physics, render_fps
from jbench.tasks.robot_checksum import older_robot_checksum, robot_checksum
from jbench.tasks.task import Task

Make = Callable[[int], Any]
"""Returns a new environment with a seed."""


class EnvironmentMaker(Task):
    """A task that makes environments, each a `dm_env.Environment` or a `gymnasium.Env` of others.

    `EnvironmentTask` adds their episodes.

    Attributes:
        reseeds: whether an episode reseeds the same environment, instead of making a new one.
        has_unit_rewards: whether all rewards must be in [0, 1].
        limit_advice: what to add so that the time limit is known, if an episode was made to
            measure it, as a clause; None if the environment says its time limit.
    """

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
            self.close_environment(environment)

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
            raise UnusableError(f"its episodes can't be seeded: {advice_on_seeds(environment)}")

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
        """Returns a new environment, which may draw itself; RequestError if it can't be made."""
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

    def reseed(self, environment: Any, seed: int) -> None:
        """Seeds the next episode of an environment."""
        if isinstance(environment, GymAsDmEnv):
            environment.reseed(seed)
        else:
            environment.task.random.seed(seed)

    def close_environment(self, environment: Any) -> None:
        """Closes an environment, if it can be closed; an error of that is a warning.

        Its work is done by then, or has failed by an error of its own.
        """
        try:
            method = getattr(environment, "close", None)
            if callable(method):
                method()
        except ERRORS_OF_OTHERS as error:
            reason = sentence_of_failure(error)
            sentence = f"{self.name}: its close fails ({reason}); no result is lost."
            warnings.warn(sentence, WorkWarning, stacklevel=2)

    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to the actuators' bounds."""
        return self._bounds.commands(actions)

    @property
    def is_of_suite(self) -> bool:
        """Whether it is a task of dm_control's suite, whose code needs no provenance of its own."""
        return self._provenance is None

    def code_provenance(self) -> dict[str, Any]:
        """See `Task.code_provenance`."""
        if self._provenance is None:
            return {}
        made = {f"task_{key}": value for key, value in self._provenance().items()}
        compiled = self.specs.compiled
        return made if compiled is None else {**made, "task_compiled": compiled}

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
