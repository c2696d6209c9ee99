"""The settings that identify an encoder, and its short name.

A short name, or representation, is the kind, the number of latents and what is not the default:
features of the observation, the base of its options, single options, and scales, such as
dae12-without-velocity-script-noise-0.2-whitened. `REPRESENTATION` is its form, and
`jbench.encoders.representations` reads it.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from jbench.encoders.features import columns, in_name, shortest
from jbench.encoders.kind import Kind
from jbench.encoders.option_names import SCALES, as_typed, options_in_name
from jbench.encoders.registry import (
    find_kind,
    kind_sources,
    latent_sizes,
    make_kind,
    options_with_epochs,
    short_name,
)
from jbench.errors import RequestError
from jbench.names import EncoderBase
from jbench.representation_names import LATENTS
from jbench.settings.base import (
    RecordSettings,
    Seed,
    in_id,
    omissible,
    settings_hash,
    typed_default,
    validated,
)
from jbench.tasks.find import find_task


class EncoderSettings(RecordSettings):
    """Settings that identify an encoder."""

    kind: str = "dae"
    task: str = "face_direction"
    dataset: str = Field(description="id of the random-policy dataset")
    latents: int = Field(
        default=12, ge=1, description="number of latents; 12 in the paper, Figures 7 and 8"
    )
    seed: Seed = 0
    options: dict[str, Any] = Field(default_factory=dict, description="every option of the kind")
    base: EncoderBase | None = omissible(None, description="source of the options, if in the name")
    named: list[str] = omissible(
        [], description="options whose values are in the name; encoders of before have none"
    )
    sources: str | None = omissible(
        None, description="checksum of the code of a kind that is not jbench's"
    )

    @model_validator(mode="after")
    def _has_a_size_of_its_kind(self) -> "EncoderSettings":
        """Refuses a number of latents that the kind does not have."""
        problem = wrong_size(self.kind, self.task, self.latents, self.options)
        if problem is None:
            return self
        if latent_sizes(self.kind, self.task, self.options):
            problem += f", not {self.latents}"
        raise ValueError(problem)

    @property
    def representation(self) -> str:
        """Name of its latents, such as dae12-whitened: kind, size, and what is not the default."""
        parts = [f"{short_name(self.kind)}{self.latents}"]
        if self.features is not None:
            parts.append(in_name(self.features))
        if self.base is not None:
            parts.append(self.base)
        if self.named:
            parts.append(options_in_name({name: self.options[name] for name in self.named}))
        return "-".join([*parts, *self._scales.values()])

    @property
    def command(self) -> str:
        """The command that trains it; omits the size of kinds with only one size."""
        assigned = {}
        if self.features is not None:
            assigned["features"] = ",".join(self.features)
        assigned.update({name: as_typed(self.options[name]) for name in self.named})
        assigned.update(self._scales)

        words = ["jbench", "train-encoder", "--kind", self.kind, "--task", self.task]
        if self.kind == "dae" and not assigned and self.base is None:
            words = ["jbench", "train-dae", "--task", self.task]
        if len(latent_sizes(self.kind, self.task, self.options)) != 1:
            words += ["--latent", f"{self.latents}"]
        if self.base is not None:
            words += ["--settings", self.base]
        for name, value in assigned.items():
            words += ["--set", f"{name}={value}"]

        return " ".join(words)

    @property
    def features(self) -> list[str] | None:
        """Features of the observation that it encodes, as `shortest` names them; None for all."""
        return self.options.get("features")

    @property
    def columns(self) -> list[int] | None:
        """Which values of the observation it encodes, in order; None for all."""
        return None if self.features is None else columns(self.task, self.features)

    @property
    def without_names(self) -> "EncoderSettings":
        """The same settings as encoders have that were trained before options were in names."""
        return self.model_copy(update={"base": None, "named": []})

    @property
    def id(self) -> str:
        """The encoder's id, such as face_direction/dae12/s00-1f9a2c4e."""
        return f"{in_id(self.task)}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def draws(self) -> str:
        """A hash that is equal for encoders that differ only in their seeds."""
        return settings_hash(self.model_dump(mode="json", exclude={"seed"}))

    @property
    def _scales(self) -> dict[str, str]:
        """The values of `SCALES` that are given, by name."""
        return {name: self.options[name] for name in SCALES if name in self.options}


def encoder_settings(
    kind: str,
    options: Mapping[str, Any],
    *,
    task: str = "face_direction",
    seed: int = 0,
    base: EncoderBase | None = None,
    episodes: int | None = None,
    mean_steps: float | None = None,
    **values: Any,
) -> EncoderSettings:
    """Returns the settings of an encoder with every option of its kind.

    Args:
        kind: name of the kind.
        options: those that are not the defaults, or not those of the base.
        task: name of the task.
        seed: random seed of the encoder.
        base: see `Kind.bases`.
        episodes: of the dataset, for epochs that suit it (`options_with_epochs`), if given.
        mean_steps: control steps of these episodes on average; None for those of the time limit.
        values: the other settings.

    Raises:
        RequestError: if an option, one of its values, a feature or the base does not exist.
    """
    found = find_kind(kind)
    if base is not None and base not in found.bases:
        raise RequestError(
            f"The settings of the {base} are for dae, not for {kind}: leave them out."
        )

    given: dict[str, Any] = {}
    if base is not None:
        given.update(found.bases[base])
    given.update(options)

    made = make_kind(kind, given)
    if made.features is not None and made.needs_all_features:
        raise RequestError(f"{kind} needs all features of the observation: leave features out.")

    full = made.values
    if episodes is not None:
        if mean_steps is None:
            mean_steps = find_task(task).episode_steps
        with_epochs = options_with_epochs(kind, given, episodes, mean_steps, seed)
        full = make_kind(kind, with_epochs).values

    features = shortest(task, made.features)
    if features is None:
        full.pop("features", None)
    else:
        full["features"] = features

    # The name says where options come from, however they were typed.
    base_in_name = _find_base(found, full)
    return validated(
        EncoderSettings,
        "the encoder",
        kind=kind,
        task=task,
        seed=seed,
        options=full,
        base=base_in_name,
        named=_named_options(found, given, full, base_in_name),
        sources=kind_sources(kind),
        **values,
    )


def _find_base(kind: type[Kind], options: Mapping[str, Any]) -> EncoderBase | None:
    """Returns the first base of a kind whose options are among these; None if there is none."""
    for base, some in kind.bases.items():
        if some.items() <= options.items():
            return base
    return None


def _named_options(
    kind: type[Kind], given: Mapping[str, Any], full: Mapping[str, Any], base: EncoderBase | None
) -> list[str]:
    """Returns the options whose values are in an encoder's name, in the order of the alphabet.

    They were given, are not the default, and no other part of the name has them.

    Args:
        kind: class of the encoder's kind.
        given: options that were given.
        full: every option of the encoder.
        base: the base that is in the name.
    """
    elsewhere = {"features", *SCALES}
    if base is not None:
        elsewhere.update(kind.bases[base])

    return sorted(
        name
        for name in given
        if name in full
        and name not in elsewhere
        and full[name] != typed_default(kind.model_fields[name])
    )


def autoencoder_options(task: str) -> str:
    """Returns what follows `jbench train-dae` for a task: fewer latents than it observes numbers.

    `LATENTS`, the default, need not be typed.
    """
    size = find_task(task).observation_size
    if size > LATENTS:
        return f" --task {task}"
    return f" --task {task} --latent {max(1, size // 2)}"


def wrong_size(kind: str, task: str, latents: int, options: Mapping[str, Any]) -> str | None:
    """Returns what is wrong with a number of latents as a clause; None if nothing is."""
    sizes = latent_sizes(kind, task, options)
    if latents in sizes:
        return None
    if not sizes:
        return f"There is no {kind} encoder of {task}; choose dae, pca or forward"
    if len(sizes) == 1:
        return f"{kind} of {task} has {sizes[0]} latents"
    return f"A {kind} encoder of {task} has {sizes[0]} to {sizes[-1]} latents"
