"""Environments that report their control steps and episodes to the recorder."""

from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from jbench.recording.recorder import Recording


class RecordedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose episodes are recorded.

    The first `reset` without a seed is seeded by the run. Rewards are those of the task, whatever
    the wrappers around this environment make of them.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], seed: int, recording: "Recording") -> None:
        """Wraps an environment whose `info` has the statistics of a finished episode."""
        super().__init__(env)
        self._seed: int | None = seed
        self._recording = recording

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        seed = self._seed if seed is None else seed
        self._seed = None
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment."""
        self._recording.on_action(action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._recording.on_step()
        # Removed, since a RecordEpisodeStatistics of the caller's own would refuse the key.
        episode = info.pop("episode", None)
        if episode is not None:
            self._recording.on_episode(float(episode["r"]), int(episode["l"]))
        return observation, reward, terminated, truncated, info
