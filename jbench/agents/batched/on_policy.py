"""The loop of PPO: act for a while, learn from just that, and forget it."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.environments import Environments, Step
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.ppo import PPO, Minibatch
from jbench.agents.batched.rollout import Rollout
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.team import Group, Team
from jbench.names import TimeLimit
from jbench.settings.algorithms import PPOSettings


class OnPolicyEngine(Engine):
    """Agents that learn from the transitions of their last rollout."""

    def __init__(
        self,
        settings: PPOSettings,
        team: Team[Any],
        environments: Environments,
        streams: Sequence[Streams],
        *,
        time_limit: TimeLimit = "bootstrap",
    ) -> None:
        """Begins with agents that know nothing.

        Args:
            settings: of the algorithm.
            team: the agents.
            environments: what they learn in; not more than a rollout has transitions.
            streams: of every seed.
            time_limit: whether the value of an episode's last state counts.
        """
        seeds, count = environments.observations.shape[:2]
        # As many transitions as the settings say, whatever the number of environments.
        steps = max(1, settings.n_steps * settings.n_envs // count)
        super().__init__(team, environments, streams, steps)
        self._settings, self._bootstrap = settings, time_limit == "bootstrap"
        self._rollout = Rollout(seeds, count, steps, environments.size, team.tensors.dtype)
        self._epochs = [
            Epochs(settings, group, group.of(streams), self._rollout) for group in team.groups
        ]
        self._outputs = torch.zeros(seeds, count, 3)

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        shape = observations.shape
        draws = [each.actions.standard_normal((shape[1], 1)) for each in self._streams]
        noise = torch.from_numpy(np.stack(draws))
        self._outputs = self._team.run(_explore, observations, noise)
        actions: NDArray[np.floating] = self._outputs[..., 0].numpy()
        return actions

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: Step) -> None:
        rewards = torch.from_numpy(step.rewards).to(self._rollout.rows.dtype)
        ended = step.episode_returns is not None
        if ended and self._bootstrap:
            # The episode was cut off: what would have followed is worth what it is worth there.
            values = self._team.run(_value, step.observations)[..., 0]
            rewards += self._settings.gamma * values
        self._rollout.add(observations, self._outputs, rewards, ended)

    def _learn(self) -> None:
        settings = self._settings
        last_values = self._team.run(_value, self.environments.observations)[..., 0]
        self._rollout.estimate(last_values, settings.gamma, settings.gae_lambda)
        for epochs in self._epochs:
            if self._still_learning(epochs.seeds):
                epochs.run()
        self._rollout.done = 0
        self.updates += settings.n_epochs

    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        done = self._rollout.done
        return {
            "rollout": self._rollout.rows[seed, :, :done],
            "ends": torch.from_numpy(self._rollout.ends[:done]),
        }

    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        rows = tensors["rollout"]
        self._rollout.done = done = rows.shape[1]
        self._rollout.rows[seed, :, :done] = rows
        self._rollout.ends[:done] = tensors["ends"].numpy()


class Epochs:
    """What one group of seeds learns from each rollout: minibatches in an order of its own.

    Attributes:
        seeds: their places.
    """

    def __init__(
        self,
        settings: PPOSettings,
        group: Group[PPO],
        streams: Sequence[Streams],
        rollout: Rollout,
    ) -> None:
        """Learns nothing yet.

        Args:
            settings: of the algorithm.
            group: that learns.
            streams: of the seeds of the group.
            rollout: of all seeds.
        """
        self.seeds = group.seeds
        self._settings, self._learner, self._streams = settings, group.learner, streams
        rows = rollout.rows[group.seeds.start : group.seeds.stop]
        # A seed's transitions, one environment after another.
        self._source = rows.flatten(0, 2)
        self._transitions = rows.shape[1] * rows.shape[2]
        self._scratch = group.learner.part.scratch
        self._rows = self._source.to(group.learner.part.device, copy=True)
        self._update = Captured(self._update_once, self._rows.device)

    def run(self) -> None:
        """Makes all updates of a rollout."""
        self._learner.reset_losses([])
        self._rows.copy_(self._source)
        for _ in range(self._settings.n_epochs):
            orders = self._orders()
            for start in range(0, self._transitions, self._settings.batch_size):
                places = orders[..., start : start + self._settings.batch_size]
                self._places(places.shape[-1]).copy_(places)
                self._update(places.shape[-1])

    def _orders(self) -> Tensor:
        """Returns the order (..., transitions) of each seed's rows in an epoch."""
        orders = [stream.updates.permutation(self._transitions) for stream in self._streams]
        if not self._learner.part.lead:
            return torch.from_numpy(orders[0])
        apart = [order + seed * self._transitions for seed, order in enumerate(orders)]
        return torch.from_numpy(np.stack(apart)).to(self._rows.device)

    def _places(self, size: int) -> Tensor:
        return self._scratch("places", size, dtype=torch.int64)

    def _update_once(self, size: Hashable) -> None:
        """Makes one update from the minibatch whose places lie ready."""
        assert isinstance(size, int)
        width = self._rows.shape[-1]
        batch = self._scratch("minibatch", size, width)
        places = self._places(size).view(-1)
        torch.index_select(self._rows, 0, places, out=batch.view(-1, width))
        self._learner.update(minibatch_of(batch))


def minibatch_of(rows: Tensor) -> Minibatch:
    """Returns rows (..., N, size + 6) of a `Rollout` as what PPO learns from."""
    return Minibatch(rows[..., :-6], *rows[..., -6:-1].split(1, dim=-1))


def _explore(agent: PPO, observations: Tensor, noise: Tensor) -> Tensor:
    return agent.explore(observations, noise)


def _value(agent: PPO, observations: Tensor) -> Tensor:
    return agent.value(observations)
