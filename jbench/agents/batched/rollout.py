"""What robots did since the last update of an on-policy agent."""

import numpy as np
import torch
from torch import Tensor

_EXTRA = 6  # numbers of a step beside the observation


class Rollout:
    """The same number of steps of each environment of each seed.

    Attributes:
        rows: (seeds, environments, steps, size + 6) of each step the observation, the action,
            its log likelihood, the observation's value, the advantage, the return and the reward.
        ends: (steps,) whether all episodes ended with a step.
        done: how many steps were added.
    """

    def __init__(
        self,
        seeds: int,
        environments: int,
        steps: int,
        observation_size: int,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        """Begins with no steps."""
        self.rows = torch.zeros(seeds, environments, steps, observation_size + _EXTRA, dtype=dtype)
        self.ends = np.zeros(steps, bool)
        self.done = 0

    def add(self, observations: Tensor, answers: Tensor, rewards: Tensor, end: bool) -> None:
        """Adds a step.

        Args:
            observations: (seeds, environments, size) that the agents saw.
            answers: (seeds, environments, 3) actions, their log likelihoods, values.
            rewards: (seeds, environments).
            end: whether the episodes ended.
        """
        now = self.rows[:, :, self.done]
        now[..., :-6].copy_(observations)
        now[..., -6:-3].copy_(answers)
        now[..., -1].copy_(rewards)
        self.ends[self.done] = end
        self.done += 1

    def estimate(self, last_values: Tensor, gamma: float, lam: float) -> None:
        """Fills in advantages and returns by generalised advantage estimation.

        Schulman et al., 2016, equation 16; a return is the advantage plus the value.

        Args:
            last_values: (seeds, environments) of the observations after the last step.
            gamma: discount.
            lam: the method's lambda.
        """
        values, rewards = self.rows[..., -4], self.rows[..., -1]
        advantage, following = torch.zeros_like(last_values), last_values
        for step in range(self.done - 1, -1, -1):
            going_on = 0.0 if self.ends[step] else 1.0
            value = values[:, :, step]
            delta = rewards[:, :, step] + gamma * following * going_on - value
            advantage = delta + gamma * lam * going_on * advantage
            self.rows[:, :, step, -3] = advantage
            following = value
        torch.add(self.rows[..., -3], values, out=self.rows[..., -2])
