"""Final training and evaluation returns of a run, as every command and the report define them."""

import numpy as np
from numpy.typing import NDArray

AVERAGED_EPISODES = 100
"""Maximum number of episodes in a final return: the paper's moving average (Figures 8 and 9)."""


def averaged_episodes(
    episodes: NDArray[np.int64], max_episodes: int = AVERAGED_EPISODES
) -> NDArray[np.int64]:
    """Returns the numbers (runs,) of last episodes to average: a quarter, 1 to the maximum."""
    return np.clip(episodes // 4, 1, max_episodes)


def final_return(returns: NDArray[np.float64]) -> float | None:
    """Returns the mean of finite returns among the `averaged_episodes`; of (episodes,); or None."""
    return _finite_mean(returns[-int(averaged_episodes(np.array(len(returns)))) :])


def final_evaluation(evaluations: NDArray[np.int32], returns: NDArray[np.float64]) -> float | None:
    """Returns the mean of finite returns of the last evaluation, or None; both are (episodes,)."""
    last = returns[evaluations == evaluations.max()] if len(evaluations) else returns
    return _finite_mean(last)


def _finite_mean(returns: NDArray[np.float64]) -> float | None:
    finite = returns[np.isfinite(returns)]
    return float(finite.mean()) if len(finite) else None
