"""What `EnvironmentWorlds` read of the time steps of environments, and what they refuse."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.tasks.environment_maker import EnvironmentMaker
from jbench.wording import counted

_ROUNDING = 1e-6  # by which rewards may exceed [0, 1]

_LARGEST_REWARD = 1e15  # agents learn in float32, which holds the square of a return of 1e18


class FlawError(ValueError):
    """What an environment returned is not as in `Task` and `Worlds`; a clause."""


class End(NamedTuple):
    """Whether a control step has ended its episode, and how."""

    is_terminated: bool
    is_truncated: bool


class TimeStepReader:
    """Reads the time steps of the environments of a task; a FlawError says what is wrong."""

    def __init__(self, task: EnvironmentMaker) -> None:
        """Has the task, which says what time steps must be like."""
        self._task = task
        self._names = list(task.parts)
        self._sizes = list(task.parts.values())

    def reward(self, timestep: Any) -> float:
        """Returns the reward of a control step, which must be a number, and perhaps in [0, 1]."""
        if timestep.reward is None:
            raise FlawError("its reward is None")

        reward = float(timestep.reward)
        if not np.isfinite(reward):
            raise FlawError(f"its reward is {reward}")
        if abs(reward) > _LARGEST_REWARD:
            raise FlawError(f"its reward is {reward:g}; scale it to at most {_LARGEST_REWARD:g}")
        if self._task.has_unit_rewards and not -_ROUNDING <= reward <= 1 + _ROUNDING:
            raise FlawError(f"its reward is {reward}, not in [0, 1]")

        return reward

    def end(self, timestep: Any, elapsed: int) -> End:
        """Returns how the control step with the number `elapsed` has ended its episode.

        A time limit that was measured, as the environment does not say it, must truncate every
        episode at the same control step.
        """
        limit = self._task.episode_steps
        is_last = bool(timestep.last())
        is_terminated = is_last and bool(timestep.discount == 0)
        is_at_limit = elapsed == limit
        if is_last and elapsed < limit and not self._task.ends_early:
            raise FlawError("its episode ends before its time limit")

        advice = self._task.limit_advice
        if advice is not None and not is_terminated and is_last != is_at_limit:
            difference = _differing(elapsed, limit)
            raise FlawError(f"{difference}, and its time limit is not known: {advice}")

        is_truncated = not is_terminated and (is_last or is_at_limit)
        return End(is_terminated, is_truncated)

    def observation(self, row: NDArray[np.float32], values: Mapping[str, Any]) -> None:
        """Writes the parts of an observation, flattened in C order, into a row (size,)."""
        lacking = [name for name in self._names if name not in values]
        if lacking:
            raise FlawError(f"its observation lacks {lacking[0]}")

        parts = [np.ravel(values[name]) for name in self._names]
        sizes = [len(part) for part in parts]
        if sizes != self._sizes:
            self._check_numbers(values, parts)
            raise FlawError(self._other_size(sizes))

        observed = np.empty_like(row)
        try:
            with np.errstate(over="ignore"):
                np.concatenate(parts, out=observed, casting="same_kind")
        except TypeError:
            self._check_numbers(values, parts)
            raise

        if not np.isfinite(observed).all():
            limit = np.finfo(np.float32).max
            pairs = zip(self._names, parts, strict=True)
            name = next(name for name, part in pairs if not (np.abs(part) <= limit).all())
            raise FlawError(f"{name} of its observation is not finite in float32")

        row[:] = observed

    def _check_numbers(self, values: Mapping[str, Any], parts: Sequence[NDArray[Any]]) -> None:
        """Raises a FlawError if a part of an observation is none of real numbers."""
        for name, part in zip(self._names, parts, strict=True):
            if part.dtype.kind not in "biuf":
                kind = part.dtype.name
                if part.dtype == object:
                    kind = type(values[name]).__name__
                raise FlawError(f"{self._subject(name)} is of type {kind}, not of real numbers")

    def _subject(self, name: str) -> str:
        """Returns a part of an observation as the subject of a clause."""
        return f"its observation {name}" if len(self._names) > 1 else "its observation"

    def _other_size(self, sizes: list[int]) -> str:
        """Returns which part of an observation has another size than the specification says."""
        for name, size, wanted in zip(self._names, sizes, self._sizes, strict=True):
            if size != wanted:
                return f"{self._subject(name)} has {counted(size, 'value')} instead of {wanted}"
        raise ValueError("All sizes are those of the specification.")


def _differing(elapsed: int, limit: int) -> str:
    """Returns how an episode differs from the one by which the time limit was measured."""
    if elapsed == limit:
        return "its episode continues, although another one was truncated at this control step"
    return f"its episode is truncated, although another one was truncated at control step {limit:,}"
