"""Rules with one defect each."""

from torch import nn
from tqc import TQC

import jbench


class NotFinite(TQC):
    """Its critics diverge at once."""

    def critic_loss(self, batch):
        return super().critic_loss(batch) / 0


class NoActor(TQC):
    """Has no network named actor."""

    losses = {"actor_loss": "policy"}  # noqa: RUF012

    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size, 1)
        self.policy = self.actor
        del self.actor


class AgentSettings(TQC):
    """Its settings are those of an agent."""

    Settings = jbench.AgentSettings


__all__ = ["nn"]
