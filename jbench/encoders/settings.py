"""The settings of an encoder."""

import math
from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from jbench import plugins
from jbench.encoders.kind import Learned
from jbench.encoders.registry import (
    kind_names,
    latent_sizes,
    make_kind,
    short_name,
    wrong_size,
)
from jbench.encoders.states import split_episodes
from jbench.errors import RequestError
from jbench.names import EPISODE_STEPS, REPRESENTATION, number_in_name
from jbench.settings.base import Seed, Settings, in_id, settings_hash, validated

SCALES = ("scale", "rescale")
"""The options of every kind that are part of a representation's name."""


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
    def representation(self) -> str:
        """The name of the latents: kind, size, and scales if not the defaults.

        For example, dae12 or dae12-observation-whitened; see `jbench.names.REPRESENTATION`.
        """
        return "-".join([f"{short_name(self.kind)}{self.latents}", *self._scales.values()])

    @property
    def command(self) -> str:
        """The command that trains it; omits the size of kinds with only one size."""
        size = "" if len(latent_sizes(self.kind, self.task)) == 1 else f" --latent {self.latents}"
        scales = [f" --set {name}={scale}" for name, scale in self._scales.items()]
        is_plain = self.kind == "dae" and not scales
        verb = "train-dae" if is_plain else f"train-encoder --kind {self.kind}"
        return "".join([f"jbench {verb} --task {self.task}{size}", *scales])

    @property
    def _scales(self) -> dict[str, str]:
        return {name: self.options[name] for name in SCALES if name in self.options}

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


def named_encoder(name: str, task: str) -> EncoderSettings | None:
    """Returns settings that a representation asks for; None for other names, such as an id.

    Their options are the scales in the name, and their dataset and seed are not those of any.

    Args:
        name: KIND:LATENTS or KINDLATENTS as tables write it, or KIND if the task determines the
            size; scales that are not the defaults follow, as in dae12-observation-whitened.

    Raises:
        RequestError: if there is no such kind, or its encoders don't have this size.
    """
    match = REPRESENTATION.fullmatch(name)
    kind = name.partition(":")[0] if match is None else match["kind"]
    if kind not in kind_names():
        if ":" not in name:
            return None
        if plugins.is_imported(name):
            example = f"--encoder {short_name(name)}12"
            raise RequestError(f"{name} is a class; type {example}, for example.")
    sizes = latent_sizes(kind, task)
    scales = {option: match[option] for option in SCALES if match and match[option]}
    latents = sizes[0] if len(sizes) == 1 and ":" not in name else 0
    if match and match["latents"]:
        latents = number_in_name(match["latents"])
    if (problem := wrong_size(kind, task, latents)) is None:
        return EncoderSettings(kind=kind, task=task, dataset="any", latents=latents, options=scales)
    if not sizes:
        raise RequestError(f"{problem}; choose dae, pca or forward.")
    size, more = ("", "") if len(sizes) == 1 else (str(min(12, sizes[-1])), ", for example")
    raise RequestError(f"{problem}; choose {'-'.join([kind + size, *scales.values()])}{more}.")


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
