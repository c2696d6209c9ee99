"""Training loop of PPO: collect a rollout, update on it, discard it."""

from collections.abc import Hashable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import BatchedEngine
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.rollout import Rollout, split_minibatch
from jbench.agents.batched.team import Group, Team
from jbench.agents.environments import Environments, StepResult
from jbench.names import TimeLimit
from jbench.settings.algorithms import PPOSettings


class OnPolicyEngine(BatchedEngine):
    """Agents that learn from the transitions of their last rollout."""

    def __init__(
        self,
        settings: PPOSettings,
        team: Team[Any],
        environments: Environments,
        *,
        time_limit: TimeLimit = "bootstrap",
    ) -> None:
        """Starts with untrained agents.

        Args:
            time_limit: "bootstrap" from an episode's last state, or treat it as "terminal".
        """
        seeds, count = environments.observations.shape[:2]
        steps = settings.rollout_steps(count)
        super().__init__(team, environments, steps)
        self._settings, self._bootstrap = settings, time_limit == "bootstrap"
        sizes = environments.size, environments.action_size
        self._rollout = Rollout(seeds, count, steps, *sizes, team.tensors.dtype)
        self._epochs = [Epochs(settings, group, self._rollout) for group in team.groups]
        self._outputs: Tensor  # of the last call of `PPO.explore`

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        shape = observations.shape[1], self.environments.action_size
        draws = [seed.actions.standard_normal(shape) for seed in self._generators]
        noise = torch.from_numpy(np.stack(draws))
        self._outputs = self._team.run(PPO.explore, observations, noise)
        actions: NDArray[np.floating] = self._outputs[..., : shape[1]].numpy()
        return actions

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        rewards = torch.from_numpy(step.rewards).to(self._rollout.rows.dtype)
        ended = step.episode_returns is not None
        if ended and self._bootstrap:
            # The episode was truncated: its last state's value stands for the missing rewards.
            values = self._team.run(PPO.value, step.observations)[..., 0]
            rewards += self._settings.gamma * values
        self._rollout.add(observations, self._outputs, rewards, ended)

    def _update(self) -> None:
        settings = self._settings
        last_values = self._team.run(PPO.value, self.environments.observations)[..., 0]
        self._rollout.estimate(last_values, settings.gamma, settings.gae_lambda)
        for epochs in self._epochs:
            if self._still_learning(epochs.seeds):
                epochs.run()
        self._rollout.steps = 0
        self.updates += settings.n_epochs

    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        steps = self._rollout.steps
        ends = torch.from_numpy(self._rollout.ends[:steps])
        return {"rollout": self._rollout.rows[seed, :, :steps], "ends": ends}

    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        rows = tensors["rollout"]
        self._rollout.steps = steps = rows.shape[1]
        self._rollout.rows[seed, :, :steps] = rows
        self._rollout.ends[:steps] = tensors["ends"].numpy()


class Epochs:
    """The updates of one group of seeds after each rollout: shuffled minibatches."""

    def __init__(self, settings: PPOSettings, group: Group[PPO], rollout: Rollout) -> None:
        """Makes the buffers; `rollout` is of all seeds."""
        self.seeds, self._group = group.seeds, group
        self._settings, self._learner = settings, group.learner
        rows = rollout.rows[group.seeds.start : group.seeds.stop]
        # Transitions of each seed, environment by environment.
        self._source = rows.flatten(0, 2)
        self._transitions = rows.shape[1] * rows.shape[2]
        self._scratch = group.learner.view.scratch
        self._rows = self._source.to(group.learner.view.device, copy=True)
        self._update = Captured(self._rows.device)

    def run(self) -> None:
        """Makes all updates of a rollout."""
        self._learner.reset_losses([])
        self._rows.copy_(self._source)
        for orders in self._orders():
            for start in range(0, self._transitions, self._settings.batch_size):
                indices = orders[..., start : start + self._settings.batch_size]
                self._indices(indices.shape[-1]).copy_(indices)
                self._update(self._update_once, indices.shape[-1])

    def _orders(self) -> Tensor:
        """Returns a random order of each seed's rows for each epoch, (epochs, ..., transitions).

        All are drawn before the first update, since nothing may wait for a GPU's updates.
        """
        epochs, count = range(self._settings.n_epochs), self._transitions
        orders = [
            np.stack([seed.updates.permutation(count) for _ in epochs])
            for seed in self._group.generators
        ]
        return self._group.stack(orders, count)

    def _indices(self, size: int) -> Tensor:
        return self._scratch("indices", size, dtype=torch.int64)

    def _update_once(self, size: Hashable) -> None:
        """Makes one update from the minibatch at the current indices."""
        assert isinstance(size, int)
        width = self._rows.shape[-1]
        batch = self._scratch("minibatch", size, width)
        indices = self._indices(size).view(-1)
        torch.index_select(self._rows, 0, indices, out=batch.view(-1, width))
        self._learner.update(split_minibatch(batch, self._learner.action_size))
