"""Bounds of the actions of stable-baselines3's models, which may be those of an environment.

Actions of jbench's policies are in [-1, 1], whatever the environment calls them.
"""

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.policies.layers import Divide, SavedLayer, Shift
from jbench.tasks.task import Task

ActionBounds = NDArray[np.float64]
"""The minimum and the maximum of each action, (2, action_size)."""


def check_unit_actions(model: Any) -> None:
    """Raises a RequestError if a model of stable-baselines3 returns other actions than in [-1, 1].

    Those of an environment with other bounds are in its units.
    """
    space = getattr(model, "action_space", None)
    if not isinstance(space, Box):
        return

    if not (np.all(space.low == -1) and np.all(space.high == 1)):
        raise RequestError(
            f"The model's actions are in {space}, and those of jbench's environments in [-1, 1]: "
            "pass a function that scales them to [-1, 1], or train the model in jbench's "
            "environment."
        )


def to_unit_actions(
    path: str, bounds: ActionBounds | None, is_scaled: bool, task: Task
) -> list[SavedLayer]:
    """Returns the layers after which 1 is the task's largest action, which may be none.

    A model may have been trained in jbench's environment, where actions are in [-1, 1], or in the
    one that it wraps, with the task's own bounds.

    Args:
        path: of the file of the model.
        bounds: of the model's actions; None if they are unknown.
        is_scaled: whether its layers return actions that are in [-1, 1] and are scaled afterwards.
        task: on which the model is to act.

    Raises:
        RequestError: if the model's bounds are others, or unknown where they matter.
    """
    unit = np.array([[-1.0], [1.0]]).repeat(task.action_size, axis=1)
    of_task = task.action_bounds
    if bounds is None:
        bounds = unit
        if not _are_equal(of_task, unit):
            raise RequestError(
                f"{path} does not say between which bounds its actions are; load the model in a "
                "module of yours that returns actions in [-1, 1], and type MODULE:NAME."
            )

    if _are_equal(bounds, unit):
        return []

    if not _are_equal(bounds, of_task):
        raise RequestError(
            f"{path} was trained with actions in {_in_words(bounds)}, but those of {task.name} are "
            f"in {_in_words(of_task)}; name the task of the model with --task, or load the model "
            "in a module of yours that returns actions in [-1, 1], and type MODULE:NAME."
        )

    if is_scaled:
        return []

    minimum, maximum = of_task
    middle = (minimum + maximum) / 2
    half_width = (maximum - minimum) / 2
    return [
        Shift(offset=-middle.astype(np.float32)),
        Divide(divisor=half_width.astype(np.float32)),
    ]


def _are_equal(bounds: ActionBounds, others: ActionBounds) -> bool:
    """Returns whether bounds of actions are equal, up to the digits in which a file has them."""
    return bounds.shape == others.shape and np.allclose(bounds, others, rtol=1e-6)


def _in_words(bounds: ActionBounds) -> str:
    """Returns bounds as [-2, 2], each once."""
    return " and ".join(dict.fromkeys(f"[{low:g}, {high:g}]" for low, high in bounds.T))
