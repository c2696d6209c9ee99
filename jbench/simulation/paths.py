"""The path of a robot in an episode, as a few points of it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.tasks import features
from jbench.tasks.features import TASK_SPECS, State

PATH_EVERY = 20
"""Control steps between two points of a path: 0.2 s, in which the hand-written policies move up to
6 cm, the distance between two feet. A whole episode has 51 points."""


class Path(NamedTuple):
    """Path of a robot in an episode.

    Attributes:
        points: (n, 3) x and y of the torso (m) and its heading (rad), float32: at the start and
            after every `PATH_EVERY` control steps.
        target: the random numbers of the episode's target: "x" and "y" (m), "yaw" (rad), or some
            of them.
    """

    points: NDArray[np.float32]
    target: dict[str, float]


def path_point(state: State) -> NDArray[np.float32]:
    """Returns the point (..., 3) of the paths of robots in this state."""
    x, y = state.position[..., 0], state.position[..., 1]
    return np.stack([x, y, features.heading(state)], axis=-1).astype(np.float32)


def path_of(task: str, points: Sequence[NDArray[np.float32]], target: NDArray[np.floating]) -> Path:
    """Returns the path through some points.

    Args:
        points: (3,) each.
        target: (k,) see `resets.target_numbers`.
    """
    names = TASK_SPECS[task].target_numbers
    return Path(np.stack(points), dict(zip(names, target.tolist(), strict=True)))
