"""Rollout buffer of an on-policy agent."""

import numpy as np
import torch
from torch import Tensor

from jbench.agents.batched.ppo import Minibatch

_EXTRA = 5  # columns besides observation and action


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
        width = observation_size + action_size + _EXTRA
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


def split_minibatch(rows: Tensor, action_size: int) -> Minibatch:
    """Returns a minibatch from rows (..., N, width) of a `Rollout`."""
    size = rows.shape[-1] - action_size - _EXTRA
    return Minibatch(*rows[..., :-1].split([size, action_size, 1, 1, 1, 1], dim=-1))
