"""Training loop of PPO: collect a rollout, update on it, discard it."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import BatchedEngine, Group
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.ppo import COLUMNS, PPO, split_minibatch
from jbench.agents.batched.tensors import Tensors
from jbench.agents.environments import Environments, StepResult
from jbench.names import TimeLimit
from jbench.settings.algorithms import PPOSettings


class OnPolicyEngine(BatchedEngine):
    """Agents that learn from the transitions of their last rollout."""

    def __init__(
        self,
        settings: PPOSettings,
        make: Callable[[Tensors], Learner],
        tensors: Tensors,
        environments: Environments,
        *,
        time_limit: TimeLimit,
        stacked: bool,
    ) -> None:
        """Starts with untrained agents; see `BatchedEngine`."""
        seeds, count = environments.observations.shape[:2]
        steps = settings.rollout_steps(count)
        super().__init__(make, tensors, environments, steps, stacked=stacked)
        self._settings, self._bootstrap = settings, time_limit == "bootstrap"
        sizes = environments.size, environments.action_size
        self._rollout = Rollout(seeds, count, steps, *sizes, tensors.dtype)
        self._group_updates = [Epochs(settings, group, self._rollout) for group in self.groups]
        self._explored: Tensor  # of the last call of `PPO.explore`

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        shape = observations.shape[1], self.environments.action_size
        self._explored = self._run(PPO.explore, observations, self._draw_normal(shape))
        actions: NDArray[np.floating] = self._explored[..., : shape[1]].numpy()
        return actions

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        rewards = torch.from_numpy(step.rewards).to(self._rollout.rows.dtype)
        ended = step.episode_returns is not None
        if ended and self._bootstrap:
            # The episode was truncated: its last state's value stands for the missing rewards.
            values = self._run(PPO.value, step.observations)[..., 0]
            rewards += self._settings.gamma * values
        self._rollout.add(observations, self._explored, rewards, ended)

    def _update(self) -> None:
        settings = self._settings
        last_values = self._run(PPO.value, self.environments.observations)[..., 0]
        self._rollout.estimate(last_values, settings.gamma, settings.gae_lambda)
        for epochs in self._group_updates:
            if self._still_learning(epochs.group):
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


class Rollout:
    """Consecutive steps of each environment of each seed.

    Attributes:
        rows: (seeds, environments, capacity, size + action_size + 5) observation, action, log
            likelihood of the action, value of the observation, advantage, return and reward of
            each step.
        ends: (capacity,) whether the episodes ended with a step.
        steps: number of steps added.
    """

    def __init__(
        self,
        seeds: int,
        environments: int,
        steps: int,
        observation_size: int,
        action_size: int,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        """Starts empty; `steps` is the capacity."""
        width = observation_size + action_size + COLUMNS
        self._size = observation_size
        self.rows = torch.zeros(seeds, environments, steps, width, dtype=dtype)
        self.ends = np.zeros(steps, bool)
        self.steps = 0

    def add(self, observations: Tensor, outputs: Tensor, rewards: Tensor, end: bool) -> None:
        """Adds a step.

        Args:
            observations: (seeds, environments, size) before the actions.
            outputs: (seeds, environments, action_size + 2) actions, their log likelihoods, values.
            rewards: (seeds, environments).
            end: whether the episodes ended.
        """
        row = self.rows[:, :, self.steps]
        row[..., : self._size].copy_(observations)
        row[..., self._size : -3].copy_(outputs)
        row[..., -1].copy_(rewards)
        self.ends[self.steps] = end
        self.steps += 1

    def estimate(self, last_values: Tensor, gamma: float, lam: float) -> None:
        """Computes advantages and returns by generalized advantage estimation.

        Source: Schulman et al., 2016, equation 16; a return is the advantage plus the value.

        Args:
            last_values: (seeds, environments) values of the observations after the last step.
        """
        values, rewards = self.rows[..., -4], self.rows[..., -1]
        advantage, next_value = torch.zeros_like(last_values), last_values
        for step in range(self.steps - 1, -1, -1):
            continues = 0.0 if self.ends[step] else 1.0
            value = values[:, :, step]
            delta = rewards[:, :, step] + gamma * next_value * continues - value
            advantage = delta + gamma * lam * continues * advantage
            self.rows[:, :, step, -3] = advantage
            next_value = value
        torch.add(self.rows[..., -3], values, out=self.rows[..., -2])


class Epochs:
    """The updates of one group of seeds after each rollout: shuffled minibatches."""

    def __init__(self, settings: PPOSettings, group: Group, rollout: Rollout) -> None:
        """Makes the buffers; `rollout` is of all seeds."""
        self.group, self._learner, self._settings = group, group.learner, settings
        rows = rollout.rows[group.seeds.start : group.seeds.stop]
        # Transitions of each seed, environment by environment.
        self._source = rows.flatten(0, 2)
        self._transitions = rows.shape[1] * rows.shape[2]
        self._view: Tensors = group.learner.view
        self._rows = self._source.to(self._view.device, copy=True)
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
            for seed in self.group.generators
        ]
        return self.group.stack(orders, count)

    def _indices(self, size: int) -> Tensor:
        return self._view.scratch("indices", size, dtype=torch.int64)

    def _update_once(self, size: int) -> None:
        """Makes one update from the minibatch at the current indices."""
        width = self._rows.shape[-1]
        batch = self._view.scratch("minibatch", size, width)
        indices = self._indices(size).view(-1)
        torch.index_select(self._rows, 0, indices, out=batch.view(-1, width))
        self._learner.update(split_minibatch(batch, self._learner.action_size))
