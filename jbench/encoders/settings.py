"""The settings of an encoder."""

import math
from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from jbench.encoders.kind import Learned
from jbench.encoders.registry import Wanted, make_kind, wrong_size
from jbench.encoders.states import split_episodes
from jbench.names import EPISODE_STEPS
from jbench.settings.base import Seed, Settings, in_id, settings_hash, validated


class EncoderSettings(Settings):
    """Settings that identify an encoder."""

    kind: str = "dae"
    task: str = "face_direction"
    dataset: str = Field(description="id of the random-policy dataset")
    latents: int = Field(default=12, ge=1, description="paper, Figures 7 and 8")
    seed: Seed = 0
    options: dict[str, Any] = Field(default_factory=dict, description="every option of the kind")

    @model_validator(mode="after")
    def _has_a_size_of_its_kind(self) -> "EncoderSettings":
        problem = wrong_size(self.kind, self.task, self.latents)
        if problem is not None:
            raise ValueError(f"{problem}, not {self.latents}")
        return self

    @property
    def wanted(self) -> Wanted:
        """What a name asks for that finds it, among other encoders."""
        return Wanted(self.kind, self.latents, self.options)

    @property
    def representation(self) -> str:
        """What the report calls observations encoded by it."""
        return self.wanted.representation

    @property
    def id(self) -> str:
        """The encoder's id, such as face_direction/dae12/s00-1f9a2c4e."""
        return f"{in_id(self.task)}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def draws(self) -> str:
        """A hash that is equal for encoders that differ only in their seeds."""
        return settings_hash(self.model_dump(mode="json", exclude={"seed"}))


def encoder_settings(kind: str, options: Mapping[str, Any], **values: Any) -> EncoderSettings:
    """Returns the settings of an encoder, with every option of its kind.

    Args:
        options: those that are not at their defaults.
        values: the other fields of `EncoderSettings`.

    Raises:
        RequestError: if there is no such kind or option, or a value is invalid.
    """
    full = make_kind(kind, options).model_dump(mode="json")
    return validated(EncoderSettings, "the encoder", kind=kind, options=full, **values)


MIN_UPDATES = 4000
"""Fewest updates of an encoder whose number of epochs is not given.

With 20,000 control steps, `dae12` then explains 0.88 of the variance on held-out episodes of
`face_direction`; in 200 epochs, 0.67.
"""


def options_with_epochs(
    kind: str, options: Mapping[str, Any], episodes: int, seed: int
) -> dict[str, Any]:
    """Returns options with a number of epochs that suits the size of the dataset.

    The default of a kind is meant for the paper's 5,000 episodes. A small dataset has few batches,
    so it is given more epochs: as many as `MIN_UPDATES` need. Epochs that are given stay.

    Raises:
        RequestError: see `make_kind`.
    """
    made = make_kind(kind, options)
    if "epochs" in options or not isinstance(made, Learned):
        return dict(options)
    learned, _ = split_episodes(episodes, seed)
    batches = math.ceil(len(learned) * EPISODE_STEPS / made.batch)
    return {**options, "epochs": max(made.epochs, math.ceil(MIN_UPDATES / batches))}
