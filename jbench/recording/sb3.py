"""Callback for models of stable-baselines3 and of libraries built on it, such as sb3-contrib."""

import warnings
from collections.abc import Callable

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from jbench.agents import sb3
from jbench.policies.copied import UnsupportedPolicyError


class RecordingCallback(BaseCallback):
    """Records the losses of a model, evaluates it when that is due, and keeps its policy."""

    def __init__(
        self,
        losses: Callable[..., None],
        evaluate: Callable[[BaseAlgorithm], object],
        keep_policy: Callable[[BaseAlgorithm], None],
    ) -> None:
        """Makes a callback of methods of a `Recording`."""
        super().__init__()
        self._losses, self._evaluate, self._keep_policy = losses, evaluate, keep_policy

    def _on_step(self) -> bool:
        model: BaseAlgorithm = self.model
        if losses := sb3.losses(model):
            self._losses(**losses)
        self._evaluate(model)
        return True

    def _on_training_end(self) -> None:
        try:
            self._keep_policy(self.model)
        except UnsupportedPolicyError as error:
            warnings.warn(str(error), stacklevel=2)
