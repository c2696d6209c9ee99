"""The environment of a run, as its agent sees it."""

from typing import Any

import gymnasium

from jbench.encoders import Encoder, load_encoder
from jbench.encoders.wrapper import EncodedObservation
from jbench.registration import environment_id
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Results


def load_run_encoder(settings: RunSettings | ExternalSettings, results: Results) -> Encoder | None:
    """Returns the encoder of a run, or None for the full observation."""
    return None if settings.encoder is None else load_encoder(results, settings.encoder)[0]


def make_env(
    settings: RunSettings | ExternalSettings, encoder: Encoder | None, robot: int = 0
) -> gymnasium.Env[Any, Any]:
    """Returns an environment with the wrappers of a run, and its robot with the given index."""
    augment = settings.augment
    env: gymnasium.Env[Any, Any] = gymnasium.make(
        environment_id(settings.task, augmented=augment is not None),
        disable_env_checker=True,
        **({} if augment is None else {"augment": augment + robot}),
    )
    env = gymnasium.wrappers.RecordEpisodeStatistics(env, buffer_length=1)
    if settings.time_limit == "terminal":
        env = TerminalTimeLimit(env)
    return env if encoder is None else EncodedObservation(env, encoder)


class TerminalTimeLimit(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Treats the time limit as terminal, without bootstrapping, as the paper's agents did."""

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment; a truncation becomes a termination."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated or truncated, False, info


class RobotSequence(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Switches through the robots of a run, one or several; each has as many episodes.

    The paper's authors kept the policy from robot to robot. Here the agent does not notice the
    switch: it keeps its networks, optimizers, entropy coefficient, step count and replay buffer. In
    the authors' experiment (1e6 steps per robot), the new robot's transitions gradually replace the
    old ones in the buffer of a million.

    The switch is made at the beginning of an episode and not between two calls of the agent's
    `learn`: those end with a rollout, which may be in the middle of an episode, so that robots
    would begin late and lose the truncated episodes.
    """

    def __init__(self, settings: RunSettings, encoder: Encoder | None) -> None:
        super().__init__(make_env(settings, encoder))
        self._settings, self._encoder, self._robot = settings, encoder, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; switches to the next robot after the last episode of this one."""
        before, episodes = self.env, self.env.get_wrapper_attr("episode_count")
        is_last = self._robot == self._settings.robots - 1
        if episodes >= self._settings.episodes_on_each and not is_last:
            self._robot += 1
            self.env = make_env(self._settings, self._encoder, self._robot)
            self.env.unwrapped.np_random = before.unwrapped.np_random
            before.close()
        return self.env.reset(seed=seed, options=options)
