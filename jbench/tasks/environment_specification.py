"""What an environment with the methods of `dm_env.Environment` says of itself.

This is its observation, the bounds of its actions, and its time limit. An UnusableError says, as a
clause, why jbench can't use an environment.
"""

import math
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.errors import ERRORS_OF_OTHERS, sentence_of_failure

_MOST_MEASURED = 100_000
"""Most control steps that are made to find a time limit that an environment does not say."""

_LEAST_PIXELS = 16
"""Height and width from which on an array with three axes is taken for a picture."""

_UNBOUNDED = 1e9  # dm_control writes 1e10 for an actuator without limits


class UnusableError(Exception):
    """Why jbench can't use an environment, as a clause without a full stop."""


class CommandBounds(NamedTuple):
    """The bounds of the commands to the actuators, in the environment's units."""

    minimum: NDArray[np.float64]  # (action_size,)
    maximum: NDArray[np.float64]  # (action_size,)

    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to commands between the bounds."""
        clipped: NDArray[np.float64] = np.clip(actions, -1, 1).astype(np.float64)
        if (self.minimum == -1).all() and (self.maximum == 1).all():
            return clipped  # without rounding
        scaled: NDArray[np.float64] = (clipped + 1) * ((self.maximum - self.minimum) / 2)
        # The sum is rounded, so it may be just above the maximum.
        commands: NDArray[np.float64] = np.clip(self.minimum + scaled, self.minimum, self.maximum)
        return commands


def read_parts(environment: Any) -> tuple[dict[str, int], tuple[str, ...]]:
    """Returns the sizes of the parts of an observation by name, and notes on those left out.

    Raises an UnusableError if the observation has no names or no values.
    """
    sizes = _sizes_of_parts(environment)
    parts = {name: size for name, size in sizes.items() if size}
    if not parts:
        raise UnusableError("its observation has no values: give it at least one number")

    empty = [name for name, size in sizes.items() if not size]
    return parts, tuple(
        f"{name} of its observation has no values and is left out" for name in empty
    )


def _sizes_of_parts(environment: Any) -> dict[str, int]:
    """Returns the number of values of each part of an observation, by its name."""
    try:
        spec = _named(environment.observation_spec())
        for name, part in spec.items():
            if isinstance(part, Mapping):
                raise UnusableError(
                    f"its observation {name} is a dictionary, not an array; return one dictionary "
                    "of named arrays"
                )
            check_is_no_picture(f"its observation {name}", part)

        return {name: math.prod(part.shape) for name, part in spec.items()}
    except UnusableError:
        raise
    except ERRORS_OF_OTHERS as error:
        sizes = _sizes_without_arrays(environment)
        if sizes is None:
            reason = f"its observation_spec fails ({sentence_of_failure(error)})"
            raise UnusableError(reason) from error
        return sizes


def check_is_no_picture(subject: str, part: Any) -> None:
    """Raises an UnusableError if a part of an observation is a picture, of bytes or scaled.

    Args:
        subject: what the part is called.
        part: a specification with `shape`, and usually `dtype`.
    """
    is_picture = getattr(part, "dtype", None) == np.uint8 and len(part.shape) > 1
    if len(part.shape) > 2:  # with colors, or of several times
        *_, height_or_width, _ = sorted(part.shape)
        is_picture |= height_or_width >= _LEAST_PIXELS

    if is_picture:
        raise UnusableError(
            f"{subject} is a picture of shape {part.shape}, and jbench takes a few "
            "numbers; give it an observation of positions and velocities"
        )


def _sizes_without_arrays(environment: Any) -> dict[str, int] | None:
    """Returns the sizes of an observation that has floats or lists; None if that is not why.

    dm_control makes no specification of floats and lists, though they are numbers.
    """
    try:
        observed = _named(environment.reset().observation)
        sizes = {name: np.asarray(part, float).size for name, part in observed.items()}
    except ERRORS_OF_OTHERS:
        return None

    has_arrays_only = all(hasattr(part, "shape") for part in observed.values())
    return None if has_arrays_only else sizes


def read_bounds(environment: Any) -> CommandBounds:
    """Returns the bounds of the actions.

    Raises an UnusableError if actions are no vector of real numbers, or one has no bounds.
    """
    try:
        spec = environment.action_spec()
        shape: tuple[int, ...] = getattr(spec, "shape", ())
        dtype = np.dtype(getattr(spec, "dtype", object))
    except UnusableError:
        raise
    except ERRORS_OF_OTHERS as error:
        raise UnusableError(f"its action_spec fails ({sentence_of_failure(error)})") from error

    if len(shape) != 1 or not shape[0] or not np.issubdtype(dtype, np.floating):
        raise UnusableError(
            f"its actions are {dtype} of shape {shape}; jbench takes a vector of real numbers"
        )

    minimum = np.full(shape, getattr(spec, "minimum", -np.inf), np.float64)
    maximum = np.full(shape, getattr(spec, "maximum", np.inf), np.float64)
    bounded = (np.abs([minimum, maximum]) < _UNBOUNDED).all(axis=0) & (minimum < maximum)
    if not bounded.all():
        i = int(np.argmin(bounded))
        raise UnusableError(
            f"its action {i} is in [{minimum[i]:g}, {maximum[i]:g}]; give it two different "
            "finite bounds, which jbench scales to [-1, 1]"
        )

    return CommandBounds(minimum, maximum)


def read_timestep(environment: Any) -> float | None:
    """Returns the simulated seconds in a control step; None if they are unknown.

    Raises an UnusableError if they are no number of seconds.
    """
    method = getattr(environment, "control_timestep", None)
    if not callable(method):
        return None

    try:
        timestep = method()
    except ERRORS_OF_OTHERS as error:
        raise UnusableError(f"its control_timestep fails ({sentence_of_failure(error)})") from error

    if timestep is None:
        return None

    is_number = isinstance(timestep, int | float | np.integer | np.floating)
    if not is_number or not 0 <= timestep < math.inf:
        raise UnusableError(f"its control_timestep is {timestep!r}, not a number of seconds")

    return float(timestep)


def declared_limit(environment: Any) -> int | None:
    """Returns the control steps of the time limit that an environment says; None if it does not."""
    limit = getattr(environment, "_step_limit", None)  # of dm_control's Environment
    if isinstance(limit, float) and math.isfinite(limit):
        return math.ceil(limit)

    known = getattr(environment, "episode_steps", None)
    if isinstance(known, int | np.integer) and known > 0:
        return int(known)

    return None


def advice_on_limit(task: str, is_gymnasium: bool) -> str:
    """Returns what makes the time limit of a task's environment known, as a clause."""
    if task.startswith("gym:"):
        return f"type {task},max_episode_steps=N with its control steps for N"
    if is_gymnasium:
        return "wrap it in gymnasium.wrappers.TimeLimit"
    return "give it the attribute episode_steps, the control steps of its time limit"


def advice_on_seeds(environment: Any) -> str:
    """Returns what makes the random numbers of an environment follow from a seed, as a clause."""
    is_composed = isinstance(getattr(environment, "random_state", None), np.random.RandomState)
    if is_composed:
        return (
            "let its function take a seed as its argument `random`, and pass this to "
            "composer.Environment as random_state"
        )
    return (
        "give its task a RandomState `random`, or let its function take a seed as its argument "
        "`random`"
    )


def measured_limit(environment: Any, bounds: CommandBounds, advice: str) -> int:
    """Returns the control steps after which an environment truncates an episode.

    The commands of the episode are halfway between the bounds. Raises an UnusableError with the
    advice of `advice_on_limit` if the environment fails, or does not show its limit.
    """
    command = (bounds.minimum + bounds.maximum) / 2
    steps = 0
    is_last = False
    try:
        environment.reset()
        while not is_last and steps < _MOST_MEASURED:
            timestep = environment.step(command)
            is_last = timestep.last()
            steps += 1
    except UnusableError:
        raise
    except ERRORS_OF_OTHERS as error:
        raise UnusableError(f"it fails ({sentence_of_failure(error)})") from error

    if not is_last:
        raise UnusableError(
            f"an episode has more than {_MOST_MEASURED:,} control steps, and its time limit is not "
            f"known: {advice}"
        )

    if timestep.discount == 0:
        raise UnusableError(
            f"its episode terminates at control step {steps}, and its time limit is not known: "
            f"{advice}"
        )

    return steps


def may_end_early(environment: Any) -> bool:
    """Returns whether an episode of an environment may end before its time limit.

    Only of dm_control's tasks it is known that they never do: those without `get_termination`.
    """
    task = getattr(environment, "task", None)
    base = getattr(sys.modules.get("dm_control.rl.control"), "Task", None)
    if base is None or not isinstance(task, base):
        return True
    return type(task).get_termination is not base.get_termination


def _named(parts: Any) -> Mapping[str, Any]:
    """Returns parts of an observation, or their specifications, by name.

    Raises an UnusableError if they have no names.
    """
    if not isinstance(parts, Mapping) or not parts or not all(parts):
        raise UnusableError("its observation has no names: return a dictionary of named arrays")
    return {str(name): part for name, part in parts.items()}
