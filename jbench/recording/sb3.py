"""Callback for models of stable-baselines3 and of libraries built on it, such as sb3-contrib."""

import warnings
from typing import TYPE_CHECKING

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from jbench.agents import sb3
from jbench.policies.copied import UnsupportedPolicyError

if TYPE_CHECKING:
    from jbench.recording.recorder import Recording


class RecordingCallback(BaseCallback):
    """Records the losses of a model, evaluates it when that is due, and keeps its policy."""

    def __init__(self, recording: "Recording") -> None:
        """Makes the callback of a recording."""
        super().__init__()
        self._recording = recording

    def _on_step(self) -> bool:
        model: BaseAlgorithm = self.model
        if losses := sb3.losses(model):
            self._recording.losses(**losses)
        self._recording.evaluate(model)
        return True

    def _on_training_end(self) -> None:
        try:
            self._recording.keep_policy(self.model)
        except UnsupportedPolicyError as error:
            warnings.warn(str(error), stacklevel=2)
