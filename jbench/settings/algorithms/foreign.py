"""Settings of algorithms of other packages, as a run records them."""

from typing import Any, ClassVar

from jbench.names import EngineName
from jbench.settings.algorithms.algorithm import Algorithm
from jbench.settings.algorithms.base import OffPolicySettings


class Foreign(Algorithm):
    """An algorithm of another package, whose own class checks its hyperparameters.

    That class is not needed to read a run.
    """

    hyperparameters: dict[str, Any]

    @classmethod
    def engines(cls, name: str) -> tuple[EngineName, ...]:
        """Only MODULE:CLASS may be a class with the interface of stable-baselines3."""
        return ("batched", "sb3", "plugin") if ":" in name else ("batched", "plugin")


class ForeignRule(Foreign):
    """An update rule of another package, which the batched engine trains.

    Its settings are those of `OffPolicySettings`, and perhaps more.
    """

    knows_rollouts: ClassVar[bool] = True

    def first_update(self, environments: int = 1) -> int:
        """See `Algorithm.first_update`."""
        return self._schedule.first_update(environments)

    @property
    def is_mirrored(self) -> bool:
        """See `Algorithm.is_mirrored`."""
        return bool(self.hyperparameters.get("mirror"))

    def rollout(self, environments: int) -> int:
        """See `Algorithm.rollout`."""
        return self._schedule.rollout(environments)

    @property
    def _schedule(self) -> OffPolicySettings:
        """Settings with the rule's times of updates; what is no such number has its default."""
        chosen: dict[str, Any] = {}
        for name, least in (("train_freq", 1), ("learning_starts", 0)):
            number = self.hyperparameters.get(name)
            if type(number) is int and number >= least:
                chosen[name] = number

        return OffPolicySettings.model_construct(**chosen)
