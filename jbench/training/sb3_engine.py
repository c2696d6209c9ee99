"""An agent of stable-baselines3, or of a class with its interface, trained by its own loop."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.agents import sb3
from jbench.agents.divergence import DivergedError, divergent_loss
from jbench.agents.environments import Ends, SeedState
from jbench.agents.sb3_policies import copy_model
from jbench.agents.training_loop import AfterStep
from jbench.closing import closed_on_error, make_all
from jbench.encoders import Encoder, on_observations
from jbench.errors import RequestError
from jbench.policies.network import SavedNetwork
from jbench.settings.run import RunSettings
from jbench.tasks.worlds import EpisodeError
from jbench.training.evaluation import make_env


class SB3Engine(AbstractContextManager["SB3Engine"]):
    """An `Engine` of one seed, without a state: such a run starts over."""

    threads = 1
    replay = None
    truncated_at_restore = None

    def __init__(self, settings: RunSettings, encoder: Encoder | None, seed: int) -> None:
        self._encoder = encoder
        make = partial(RobotSequence, settings, encoder)
        self._robots = make_all(settings.environments, make, RobotSequence.close)
        with closed_on_error(*self._robots):
            env = DummyVecEnv([partial(_made, robot) for robot in self._robots])
            self._agent = sb3.build(settings.algo, settings.algorithm, env, seed)

        self._rollout = sb3.rollout(self._agent)
        self.diverged: dict[int, DivergedError] = {}
        self.failures: dict[int, EpisodeError] = {}  # none: an error ends the loop
        self._policy: SavedNetwork | None = None

    @property
    def control_steps(self) -> int:
        """Control steps over all environments."""
        return self._agent.num_timesteps

    @property
    def updates(self) -> int:
        """Number of updates; of PPO, epochs."""
        return int(self._agent._n_updates)

    def __exit__(self, *_: object) -> None:
        """Closes the environments."""
        env = self._agent.get_env()
        if env is not None:
            env.close()

    def train(self, steps: int, after_step: AfterStep) -> None:
        """Trains until `steps` control steps are made, or `after_step` returns False."""

        def on_step(values: dict[str, Any], _: object) -> bool:
            self._policy = None
            self._check(actions=values["actions"])
            return after_step(_ends(values["infos"]))

        try:
            self._agent.learn(steps, on_step, log_interval=None)  # type: ignore[arg-type]
        except (EpisodeError, RequestError):
            # The environment refuses an action that is not finite before its step is counted.
            self._check(actions=[robot.last_action for robot in self._robots])
            if not self.diverged:
                raise
            after_step(None)
        self._policy = None

    def has_made(self, steps: int) -> bool:
        """See `Engine.has_made`; the loop ends with a rollout."""
        last = -(-steps // self._rollout) * self._rollout
        return self.control_steps >= last

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns deterministic actions (..., dim(A)) for observations (..., dim(O))."""
        act = on_observations(self._encoder, self.policy(0).act)
        actions: NDArray[np.floating] = act(observations)
        return actions

    def policy(self, seed: int) -> SavedNetwork:
        """Returns a copy of the agent's deterministic policy."""
        if self._policy is None:
            self._policy = copy_model(self._agent)
        return self._policy

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses by database name; empty before the first update."""
        return sb3.losses(self._agent)

    def state(self, seed: int) -> None:
        """Returns None: there is no state from which it could resume."""

    def restore(self, states: Sequence[SeedState]) -> None:
        """Is not called, as there are no states."""
        raise NotImplementedError

    def check_weights(self) -> None:
        """Records a divergence if a loss or a weight is not finite."""
        for parameters in self._agent.policy.parameters():
            self._check(weights=parameters.detach().numpy())

    def _check(self, **values: ArrayLike) -> None:
        """Records a divergence if a loss or one of the values, by name, is not finite."""
        infinite = [name for name, numbers in values.items() if not np.isfinite(numbers).all()]
        for what in filter(None, (divergent_loss(sb3.losses(self._agent)), *infinite)):
            self.diverged.setdefault(0, DivergedError(self.updates, self.control_steps, what))


def _ends(infos: Sequence[Mapping[str, Any]]) -> Ends | None:
    """Returns the episodes that have ended, of one seed, if there are any."""
    ended = [info for info in infos if "episode" in info]
    if not ended:
        return None
    is_truncated = [info.get("TimeLimit.truncated", False) for info in ended]
    return Ends(
        np.ones((1, len(ended)), bool),
        ~np.array([is_truncated]),
        np.array([[info["episode"]["r"] for info in ended]], np.float64),
        np.array([[info["episode"]["l"] for info in ended]], np.int64),
    )


def _made(environment: "RobotSequence") -> "RobotSequence":
    """Returns an environment, as the functions do that `DummyVecEnv` takes."""
    return environment


class RobotSequence(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Switches through the robots of a run, one or several; each has as many episodes.

    The paper's authors kept the policy from robot to robot. Here the agent does not notice the
    switch: it keeps its networks, optimizers, entropy coefficient, step count and replay buffer,
    in which the new robot's transitions gradually replace the old ones. The switch is made at the
    beginning of an episode and not between two calls of the agent's `learn`: those end with a
    rollout, which may be in the middle of an episode, so that robots would begin late.
    """

    def __init__(self, settings: RunSettings, encoder: Encoder | None) -> None:
        env = make_env(settings, encoder)
        super().__init__(env)
        self._settings = settings
        self._encoder = encoder
        self._robot = 0
        self.last_action: Any = np.zeros(env.action_space.shape or ())

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the robot, and keeps the action, which may be the cause of its failure."""
        self.last_action = action
        return self.env.step(action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; switches to the next robot after the last episode of this one."""
        before = self.env
        episodes = self.env.get_wrapper_attr("episode_count")
        is_last = self._robot == self._settings.robots - 1
        if episodes >= self._settings.episodes_on_each and not is_last:
            self._robot += 1
            self.env = make_env(self._settings, self._encoder, self._robot)
            self.env.unwrapped.np_random = before.unwrapped.np_random
            before.close()
        return self.env.reset(seed=seed, options=options)
