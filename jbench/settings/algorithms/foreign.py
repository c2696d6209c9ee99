"""Settings of algorithms of other packages, as a run records them."""

from typing import Any

from jbench.names import EngineName
from jbench.settings.algorithms.algorithm import Algorithm


class Foreign(Algorithm):
    """An algorithm of another package, whose own class checks its hyperparameters.

    That class is not needed to read a run.
    """

    hyperparameters: dict[str, Any]

    @classmethod
    def engines(cls, name: str) -> tuple[EngineName, ...]:
        """Only MODULE:CLASS may be a class with the interface of stable-baselines3."""
        return ("batched", "sb3", "plugin") if ":" in name else ("batched", "plugin")

    @property
    def is_mirrored(self) -> bool:
        """See `Algorithm.is_mirrored`; rules have the setting `mirror`."""
        return bool(self.hyperparameters.get("mirror"))
