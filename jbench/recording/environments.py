"""Environments that report their control steps and episodes to the recorder."""

from typing import Any, Protocol

import gymnasium
import numpy as np


class Listener(Protocol):
    """What an environment reports to."""

    def on_action(self, action: Any) -> None:
        """Called before each control step."""

    def on_step(self) -> None:
        """Called after each control step."""

    def on_episode(self, episode_return: float, length: int) -> None:
        """Called after the last control step of an episode."""


class RecordedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose episodes are recorded.

    The first `reset` without a seed is seeded by the run. Rewards are those of the task, whatever
    the wrappers around this environment make of them.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], seed: int, listener: Listener) -> None:
        """Wraps an environment whose `info` has the statistics of a finished episode."""
        super().__init__(env)
        self._seed: int | None = seed
        self._listener = listener

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        seed = self._seed if seed is None else seed
        self._seed = None
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment."""
        self._listener.on_action(action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._listener.on_step()
        # Removed, since a RecordEpisodeStatistics of the caller's own would refuse the key.
        episode = info.pop("episode", None)
        if episode is not None:
            self._listener.on_episode(float(episode["r"]), int(episode["l"]))
        return observation, reward, terminated, truncated, info


def is_finite(action: Any) -> bool:
    """Returns whether all numbers of an action are finite."""
    return bool(np.isfinite(np.asarray(action, np.float64)).all())
