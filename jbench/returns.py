"""Final training and evaluation returns of a run, as every command and the report define them."""

import numpy as np
from numpy.typing import NDArray

FINAL_EPISODES = 100
"""Maximum number of episodes in a final return: the paper's moving average (Figures 8 and 9)."""


def final_episodes(
    episodes: NDArray[np.int64], max_episodes: int = FINAL_EPISODES
) -> NDArray[np.int64]:
    """Returns the number of last episodes over which the final return is averaged.

    This is a quarter of the (runs,) numbers of episodes, limited to 1 to `max_episodes`.
    """
    return np.clip(episodes // 4, 1, max_episodes)


def final_return(returns: NDArray[np.float64]) -> float | None:
    """Returns the mean of the last `final_episodes` of a run's returns (episodes,) in order.

    Non-finite returns are ignored; None if none of them is finite.
    """
    return _finite_mean(returns[-int(final_episodes(np.array(len(returns)))) :])


def final_evaluation(evaluations: NDArray[np.int32], returns: NDArray[np.float64]) -> float | None:
    """Returns the mean return of the last evaluation; `evaluations` and `returns` are (episodes,).

    None if there is none, or no finite return in it.
    """
    last = returns[evaluations == evaluations.max()] if len(evaluations) else returns
    return _finite_mean(last)


def _finite_mean(returns: NDArray[np.float64]) -> float | None:
    finite = returns[np.isfinite(returns)]
    return float(finite.mean()) if len(finite) else None
