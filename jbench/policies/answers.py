"""Actions that code of others has returned, as an array."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_actions(answer: Any, wanted: tuple[int, int]) -> NDArray[np.float64]:
    """Returns an answer as an array of actions.

    Args:
        answer: what the code returned; of a tensor, its numpy array.
        wanted: (observations, action_size).

    Raises:
        ValueError: if the answer has another shape, or is no array of numbers, such as rows of
            unequal lengths or a tuple; its text is what was returned, for a message.
    """
    kind = f"a {type(answer).__name__} that is no array of numbers"
    if answer is None or isinstance(answer, tuple):
        raise ValueError(kind)
    try:
        actions = np.array(answer, np.float64)
    except (TypeError, ValueError):
        raise ValueError(kind) from None

    if actions.shape != wanted:
        raise ValueError(f"the shape {actions.shape}")
    return actions
