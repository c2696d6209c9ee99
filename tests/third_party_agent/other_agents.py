"""A policy, and agents with one defect each."""

import numpy as np
import torch
from random_search import RandomSearch
from torch import nn

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


class WrongShape(RandomSearch):
    """Returns actions of one dimension."""

    def explore(self, observations):
        return super().explore(observations)[:, 0]


class _LaterNotFinite(RandomSearch):
    steps = 0

    def learn(self, transition):
        self.steps += 1
        return super().learn(transition)


class NotFinite(_LaterNotFinite):
    """Returns NaN after 120 control steps."""

    def explore(self, observations):
        return super().explore(observations) * (np.nan if self.steps == 120 else 1)


class NotFiniteWeights(_LaterNotFinite):
    """Its deterministic policy has a NaN, its exploration does not."""

    def policy(self):
        module = super().policy()
        if self.steps:
            torch.nn.init.constant_(module[0].weight, np.nan)
        return module


class UnknownLoss(RandomSearch):
    """Returns a loss that the table episodes has no column for."""

    def learn(self, transition):
        return {"q_loss": 0.5}


class UnsavedPolicy(RandomSearch):
    """Has a layer that jbench can't save."""

    def policy(self):
        return nn.Sequential(super().policy(), nn.Softsign())


class Raises(RandomSearch):
    """Has a mistake in its code."""

    def learn(self, transition):
        return {"critic_loss": self.missing}
