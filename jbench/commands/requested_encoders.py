"""The encoders that a user asks train-encoder for, as settings."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

from jbench import names, typed_values
from jbench.representation_names import ENCODER_KINDS, LATENTS

if TYPE_CHECKING:
    from jbench.datasets import Dataset
    from jbench.encoders.settings import EncoderSettings
    from jbench.encoders.states import States


@dataclass(frozen=True)
class Wanted:
    """The encoders that a user wants.

    Attributes:
        kinds: names with commas.
        options: of the kinds, those that were typed.
        base: source of the other options.
        latent: numbers of latents as typed, or None for 12 or the only size.
        tasks, seeds: an encoder for each.
    """

    kinds: str
    options: dict[str, Any]
    base: names.EncoderBase | None
    latent: str | None
    tasks: Sequence[str]
    seeds: Sequence[int]


def planned_encoders(wanted: Wanted, source: "Dataset | None") -> list["EncoderSettings"]:
    """Returns the settings of an encoder for each task, seed, kind and number of latents.

    If any kind has several sizes, --latent is ignored for kinds that have only one. The dataset is
    None if it is not known yet.
    """
    from jbench.encoders.registry import latent_sizes
    from jbench.encoders.settings import encoder_settings
    from jbench.encoders.states import check_episodes

    typed = wanted.options
    latent = wanted.latent or str(LATENTS)
    numbers = typed_values.parse_numbers(latent, "--latent", "12, or 2,4,8, or 1-16")
    kinds = dict.fromkeys(
        typed_values.lowered(name, ENCODER_KINDS) for name in wanted.kinds.split(",")
    )
    about_dataset: dict[str, Any] = {"dataset": "any"}
    if source is not None:
        check_episodes(source)
        about_dataset = {
            "dataset": source.id,
            "episodes": source.episodes,
            "mean_steps": source.control_steps / source.episodes,
        }

    planned = []
    for task in wanted.tasks:
        possible = {kind: list(latent_sizes(kind, task, typed)) for kind in kinds}
        only = {kind: sizes for kind, sizes in possible.items() if len(sizes) == 1}
        if wanted.latent is not None and len(only) == len(kinds):
            only.clear()

        for seed, kind in product(wanted.seeds, kinds):
            planned += [
                encoder_settings(
                    kind,
                    typed,
                    task=task,
                    seed=seed,
                    base=wanted.base,
                    latents=size,
                    **about_dataset,
                )
                for size in only.get(kind, numbers)
            ]

    return planned


def with_known_size(encoder: "EncoderSettings", states: "States") -> "EncoderSettings":
    """Returns settings with the number of latents that a kind of another package has."""
    import torch

    from jbench.encoders.kind import Fitted
    from jbench.encoders.registry import find_kind, latent_sizes
    from jbench.encoders.training import counted_latents

    if encoder.kind in ENCODER_KINDS or not issubclass(find_kind(encoder.kind), Fitted):
        return encoder
    if len(latent_sizes(encoder.kind, encoder.task, encoder.options)) <= 1:
        return encoder

    states.read(torch.device("cpu"))
    observed = states
    if encoder.columns is not None:
        observed = states.only(encoder.columns)

    count = counted_latents(encoder.kind, encoder.options, observed, encoder.latents)
    return encoder.model_copy(update={"latents": count})
