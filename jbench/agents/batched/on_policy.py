"""Training loop of PPO: collect a rollout, update on it, discard it."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import BatchedEngine, SeedGroup
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.ppo import PPOLearner, Transitions
from jbench.agents.batched.tensors import Tensors
from jbench.agents.environments import StepResult
from jbench.settings.algorithms import PPOSettings


class OnPolicyEngine(BatchedEngine[PPOLearner]):
    """Agents that learn from the transitions of their last rollout."""

    _settings: PPOSettings
    replay = None

    def _make_buffers(self) -> None:
        """Makes the rollout, and the updates of each group."""
        settings = self._settings
        environments = self.environments
        seeds, count = environments.observations.shape[:2]
        steps = settings.rollout_steps(count)
        width = Transitions.width(environments.size, environments.action_size)
        rows = torch.zeros(seeds, count, steps, width, dtype=self.tensors.dtype)
        self._rollout = Transitions(rows, environments.action_size)
        self._ends = np.zeros((seeds, count, steps), bool)
        self.group_updates = [Epochs(settings, group, self._rollout) for group in self.groups]
        self._explored: Tensor  # of the last call of `PPOLearner.explore`

    def _explore(self, observations: Tensor) -> NDArray[np.floating]:
        """See `BatchedEngine._explore`."""
        shape = observations.shape[1], self.environments.action_size
        self._explored = self._run(PPOLearner.explore, observations, self._draw_normal(shape))
        actions: NDArray[np.floating] = self._explored[..., : shape[1]].numpy()
        return actions

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        """Writes the transitions of a control step into the rollout."""
        rollout = self._rollout
        newest = self._collected - 1
        rewards = torch.from_numpy(step.rewards).to(rollout.rows.dtype)
        if step.ends is not None and self._time_limit == "bootstrap":
            rewards += self._missing_rewards(step)
        # As the policy saw them that chose the actions: the update compares it with a newer policy,
        # and both must have the same inputs.
        rollout.observations[:, :, newest].copy_(self._standardized(observations))
        rollout.explored[:, :, newest].copy_(self._explored)
        rollout.rewards[:, :, newest, 0].copy_(rewards)
        self._ends[:, :, newest] = False if step.ends is None else step.ends.ended

    def _missing_rewards(self, step: StepResult) -> Tensor:
        """Returns what stands for the rewards after a truncation: gamma V of the last state.

        It is (seeds, environments), and 0 where no episode was truncated.
        """
        assert step.ends is not None
        truncated = torch.from_numpy(step.ends.ended & ~step.ends.terminated)
        values = self._run(PPOLearner.value, step.observations)[..., 0]
        return torch.where(truncated, self._settings.gamma * values, 0.0)

    def _truncate(self, step: StepResult) -> None:
        """See `TrainingLoop._truncate`."""
        assert step.ends is not None
        newest = self._collected - 1
        self._rollout.rewards[:, :, newest, 0] += self._missing_rewards(step)
        self._ends[:, :, newest] |= step.ends.ended

    def _update(self) -> None:
        """See `BatchedEngine._update`."""
        settings = self._settings
        last_values = self._run(PPOLearner.value, self.environments.observations)[..., 0]
        write_advantages(self._rollout, self._ends, last_values, settings)
        for epochs in self.group_updates:
            if self._still_learning(epochs.group):
                epochs.run()
        self.updates += settings.n_epochs

    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """See `BatchedEngine._loop_state`."""
        ends = torch.from_numpy(self._ends[seed, :, : self._collected])
        return {"rollout": self._rollout.rows[seed, :, : self._collected], "ends": ends}

    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """See `BatchedEngine._restore_loop`."""
        rows = tensors["rollout"]
        self._rollout.rows[seed, :, : rows.shape[1]] = rows
        # Older versions saved whether all environments ended, (steps,).
        self._ends[seed, :, : rows.shape[1]] = tensors["ends"].numpy()


def write_advantages(
    rollout: Transitions, ends: NDArray[np.bool_], last_values: Tensor, settings: PPOSettings
) -> None:
    """Writes advantages (Schulman et al., 2016, equation 16) and returns into a rollout.

    A return is the sum of advantage and value.

    Args:
        rollout: (seeds, environments, steps, any), with rewards and the values of its states.
        ends: (seeds, environments, steps), or less that broadcasts to it: whether an episode ended
            with a step.
        last_values: (seeds, environments) values of the observations after the last step.
    """
    gamma = settings.gamma
    values = rollout.values[..., 0]
    rewards = rollout.rewards[..., 0]
    advantages = rollout.advantages[..., 0]

    advantage = torch.zeros_like(last_values)
    next_value = last_values
    going_on = torch.from_numpy(~ends).to(values.dtype).expand(values.shape)
    for step in reversed(range(values.shape[-1])):
        continues = going_on[..., step]
        value = values[:, :, step]
        delta = rewards[:, :, step] + gamma * next_value * continues - value
        advantage = delta + gamma * settings.gae_lambda * continues * advantage
        advantages[:, :, step] = advantage
        next_value = value

    torch.add(advantages, values, out=rollout.returns[..., 0])


class Epochs:
    """The updates of one group of seeds after each rollout: shuffled minibatches."""

    def __init__(
        self, settings: PPOSettings, group: SeedGroup[PPOLearner], rollout: Transitions
    ) -> None:
        self.group = group
        self._learner = group.learner
        self._settings = settings
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
        # All are drawn before the first update, since nothing may wait for a GPU's updates.
        epochs = range(self._settings.n_epochs)
        count = self._transitions
        generators = [seed.updates for seed in self.group.generators]
        draws = []
        for generator in generators:
            draws.append(np.stack([generator.permutation(count) for _ in epochs]))

        for orders in self.group.stack(draws, count):
            for start in range(0, self._transitions, self._settings.batch_size):
                indices = orders[..., start : start + self._settings.batch_size]
                self._indices(indices.shape[-1]).copy_(indices)
                self._update(self._update_once, indices.shape[-1])

    def _indices(self, size: int) -> Tensor:
        """Returns the buffer of the indices of a minibatch."""
        return self._view.scratch("indices", size, dtype=torch.int64)

    def _update_once(self, size: int) -> None:
        """Updates the agents on the transitions whose indices are in the buffer."""
        width = self._rows.shape[-1]
        batch = self._view.scratch("minibatch", size, width)
        indices = self._indices(size).view(-1)
        torch.index_select(self._rows, 0, indices, out=batch.view(-1, width))
        self._learner.update(Transitions(batch, self._learner.action_size))
