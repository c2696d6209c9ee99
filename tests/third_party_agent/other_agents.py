"""A policy, and agents with one defect each."""

import numpy as np
import torch
from random_search import RandomSearch

import jbench


def bang_bang(observations):
    """A policy: maximum action, whose sign depends on the angle to the target."""
    return np.sign(observations[:, -1:])


class WithoutState(RandomSearch):
    """Can't be resumed."""

    state = jbench.Agent.state


class NoSettings(RandomSearch):
    """Has an object in place of the class of its settings."""

    Settings = RandomSearch.Settings()


class NotFiniteWeights(RandomSearch):
    """Its deterministic policy has a NaN after a step, its exploration does not."""

    steps = 0

    def learn(self, transition):
        self.steps += 1
        return super().learn(transition)

    def policy(self):
        module = super().policy()
        if self.steps:
            torch.nn.init.constant_(module[0].weight, np.nan)
        return module


class UnknownLoss(RandomSearch):
    """Returns a loss that the table episodes has no column for."""

    def learn(self, transition):
        return {"q_loss": 0.5}


class Raises(RandomSearch):
    """Has a mistake in its code."""

    def learn(self, transition):
        return {"critic_loss": self.missing}
