"""A Gymnasium environment with the methods of a `dm_env.Environment`.

What the observation is called is decided here, so a change of names changes the columns of
datasets: `Box` observations are `observation`, and the parts of `Dict` and `Tuple` observations
have their keys and numbers, joined by underscores.
"""

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit
from numpy.typing import NDArray

from jbench.tasks.environment_specification import UnusableError, check_is_no_picture

_ONLY_PART = "observation"
"""Name of an observation that has no named parts."""


class Spec(NamedTuple):
    """Shape and type of an array, as of `dm_env.specs.Array`."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    minimum: Any = -np.inf
    maximum: Any = np.inf


class TimeStep(NamedTuple):
    """What follows a reset or a control step, as `dm_env.TimeStep`."""

    observation: dict[str, Any]
    reward: float | None = None
    discount: float | None = None
    has_ended: bool = False

    def last(self) -> bool:
        """Returns whether the episode has ended."""
        return self.has_ended


class GymAsDmEnv:
    """A Gymnasium environment whose episodes are seeded by `reseed`."""

    def __init__(self, env: gymnasium.Env[Any, Any], seed: int = 0) -> None:
        """Has an environment, and the seed of its first episode."""
        self.env = env
        self._seed = seed

    @property
    def physics(self) -> Any:
        """The model and data of an environment of MuJoCo; None of others."""
        inner = self.env.unwrapped
        model = getattr(inner, "model", None)
        data = getattr(inner, "data", None)
        is_mujoco = type(model).__name__ == "MjModel" and type(data).__name__ == "MjData"
        return SimpleNamespace(model=model, data=data) if is_mujoco else None

    @property
    def episode_steps(self) -> int | None:
        """Control steps of the time limit of the environment, if one is known.

        It is that of its specification, or of the wrapper `TimeLimit`.
        """
        if self.env.spec is not None and self.env.spec.max_episode_steps is not None:
            return self.env.spec.max_episode_steps
        env = self.env
        while isinstance(env, gymnasium.Wrapper):
            if isinstance(env, TimeLimit):
                return env._max_episode_steps
            env = env.env
        return None

    def control_timestep(self) -> float | None:
        """Returns the simulated seconds in a control step; None if unknown."""
        timestep = getattr(self.env.unwrapped, "dt", None)
        return float(timestep) if isinstance(timestep, float | int) and timestep > 0 else None

    def notes(self) -> tuple[str, ...]:
        """Returns what users should know of its wrappers, as clauses."""
        env = self.env
        found = []
        declared = self.episode_steps
        while isinstance(env, gymnasium.Wrapper):
            if isinstance(env, TimeLimit) and declared and env._max_episode_steps < declared:
                found.append(
                    f"an inner wrapper TimeLimit ends its episodes at control step "
                    f"{env._max_episode_steps:,}, before its time limit of {declared:,}; pass "
                    "max_episode_steps to gymnasium.make instead of a second TimeLimit"
                )
            elif isinstance(env, NormalizeObservation):
                found.append(
                    "its wrapper NormalizeObservation has statistics of its own in each copy of "
                    "the environment, so agents are evaluated with others than they were trained "
                    "with; leave it out, and type --set normalize=running"
                )
            elif isinstance(env, NormalizeReward):
                found.append(
                    "its wrapper NormalizeReward changes the rewards, and so the returns, by "
                    "statistics of its own in each copy of the environment; leave it out"
                )
            env = env.env
        return tuple(found)

    def reseed(self, seed: int) -> None:
        """Seeds the next episode."""
        self._seed = seed

    def observation_spec(self) -> dict[str, Spec]:
        """Returns the parts of the observation; one that is not of numbers is an UnusableError.

        So are two parts of one name, and an environment that opens a window, which ends the process
        where there is no display.
        """
        if self.env.render_mode == "human":
            raise UnusableError("it opens a window; make it without render_mode human")

        parts: dict[str, Any] = {}
        for name, space in _parts("", self.env.observation_space):
            _check_part(name, space)
            if name in parts:
                raise UnusableError(f"two parts of its observation are called {name}; rename one")
            parts[name] = space

        return {name: Spec(space.shape, space.dtype) for name, space in parts.items()}

    def action_spec(self) -> Spec:
        """Returns the bounds of the actions, flattened; those without are an UnusableError."""
        space = self.env.action_space
        if not isinstance(space, spaces.Box):
            raise UnusableError(
                f"its actions are {type(space).__name__}, and jbench trains on motors; give it a "
                "Box of real numbers"
            )
        return Spec(
            shape=(int(np.prod(space.shape)),),
            dtype=space.dtype,
            minimum=space.low.ravel(),
            maximum=space.high.ravel(),
        )

    def reset(self) -> TimeStep:
        """Begins an episode."""
        reset = partial(self.env.reset, seed=self._seed)
        observation, _ = _values_of("reset", reset, ("observation", "info"))
        return TimeStep(self._observed(observation))

    def step(self, action: NDArray[np.float64]) -> TimeStep:
        """Applies an action (size,) for one control step."""
        space = self.env.action_space
        command = np.asarray(action, space.dtype).reshape(space.shape)
        step = partial(self.env.step, command)
        wanted = ("observation", "reward", "terminated", "truncated", "info")
        observation, reward, terminated, truncated, _ = _values_of("step", step, wanted)
        discount = 0.0 if terminated else 1.0
        ended = bool(terminated or truncated)
        return TimeStep(self._observed(observation), _number(reward), discount, ended)

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def _observed(self, observation: Any) -> dict[str, Any]:
        """Returns the values of the parts of an observation by name."""
        return dict(_values("", self.env.observation_space, observation))


def _joined(prefix: str, name: object) -> str:
    """Returns the name of a part of a part."""
    return f"{prefix}_{name}" if prefix else str(name)


def _parts(prefix: str, space: spaces.Space[Any]) -> Iterator[tuple[str, Any]]:
    """Yields the spaces of the parts of an observation, each with its name."""
    if isinstance(space, spaces.Dict):
        for name, part in space.spaces.items():
            yield from _parts(_joined(prefix, name), part)
    elif isinstance(space, spaces.Tuple):
        for number, part in enumerate(space.spaces):
            yield from _parts(_joined(prefix or "part", number), part)
    else:
        yield prefix or _ONLY_PART, space


def _values(prefix: str, space: spaces.Space[Any], observation: Any) -> Iterator[tuple[str, Any]]:
    """Yields the values of the parts of an observation, each with its name.

    Those that the observation lacks, or has beyond its space, are left out.
    """
    if isinstance(space, spaces.Dict) and isinstance(observation, Mapping):
        for name, part in space.spaces.items():
            if name in observation:
                yield from _values(_joined(prefix, name), part, observation[name])
    elif isinstance(space, spaces.Tuple) and isinstance(observation, tuple | list):
        for number, (part, value) in enumerate(zip(space.spaces, observation, strict=False)):
            yield from _values(_joined(prefix or "part", number), part, value)
    elif isinstance(space, spaces.Box):
        yield prefix or _ONLY_PART, observation


def _values_of(method: str, call: Callable[[], Any], wanted: Sequence[str]) -> tuple[Any, ...]:
    """Returns what a method of an environment returns: a tuple of the values that are wanted.

    Anything else, such as what the older library Gym returned, is an UnusableError.
    """
    returned = None
    try:
        returned = call()
    except ValueError as error:
        if not _is_of_unpacking_in_wrapper(error):
            raise

    if isinstance(returned, tuple) and len(returned) == len(wanted):
        return returned

    raise UnusableError(
        f"its {method} does not return the {len(wanted)} values of a gymnasium.Env: "
        f"{', '.join(wanted)}"
    )


def _is_of_unpacking_in_wrapper(error: ValueError) -> bool:
    """Returns whether a wrapper of Gymnasium got too few or too many values."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    library = Path(gymnasium.__file__).parent
    return "values to unpack" in str(error) and Path(last.filename).is_relative_to(library)


def _number(reward: Any) -> float:
    """Returns a reward as a number; one that is none is an UnusableError."""
    try:
        return float(reward)
    except (TypeError, ValueError):
        shown = " ".join(repr(reward).split())
        raise UnusableError(f"its reward is {shown[:100]}, not a number") from None


def _check_part(name: str, space: spaces.Space[Any]) -> None:
    """Raises an UnusableError if a part of an observation is not a few real numbers."""
    subject = "its observation" if name == _ONLY_PART else f"its observation {name}"
    if not isinstance(space, spaces.Box):
        advice = "give it a Box"
        if space.is_np_flattenable:
            advice = "wrap it in gymnasium.wrappers.FlattenObservation"
        raise UnusableError(
            f"{subject} is {type(space).__name__}, and jbench takes real numbers; {advice}"
        )
    check_is_no_picture(subject, space)
