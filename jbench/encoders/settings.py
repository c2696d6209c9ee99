"""The settings that identify an encoder, its short name, and how the name is read.

A short name, or representation, is the kind, the number of latents and what is not the default:
features of the observation, the base of its options, single options, and scales, such as
dae12-without-velocity-script-noise-0.2-whitened. `REPRESENTATION` is its form.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from jbench import plugins
from jbench.encoders.features import HASHED, columns, from_name, in_name, shortest
from jbench.encoders.registry import (
    find_kind,
    kind_names,
    kind_sources,
    latent_sizes,
    make_kind,
    options_with_epochs,
    short_name,
)
from jbench.errors import RequestError
from jbench.names import REPRESENTATION, EncoderBase
from jbench.settings.base import (
    Seed,
    Settings,
    in_id,
    omissible,
    settings_hash,
    typed_default,
    validated,
)
from jbench.tasks.find import find_task

_SCALES = ("scale", "rescale")  # the last parts of a name, by their values
_HASHED_OPTIONS = "options"  # word before the hash of options whose values are too long
_LONGEST = 60  # characters of options in a name
_OPTION = re.compile(r"-([a-z_]+)-([A-Za-z0-9_.]+)")


class EncoderSettings(Settings):
    """Settings that identify an encoder."""

    kind: str = "dae"
    task: str = "face_direction"
    dataset: str = Field(description="id of the random-policy dataset")
    latents: int = Field(default=12, ge=1, description="paper, Figures 7 and 8")
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
        problem = _wrong_size(self.kind, self.task, self.latents, self.options)
        if problem is not None:
            possible = latent_sizes(self.kind, self.task, self.options)
            raise ValueError(f"{problem}, not {self.latents}" if possible else problem)
        return self

    @property
    def representation(self) -> str:
        """Name of its latents, such as dae12-whitened: kind, size, and what is not the default."""
        parts = [f"{short_name(self.kind)}{self.latents}"]
        if self.features is not None:
            parts.append(in_name(self.features))
        if self.base is not None:
            parts.append(self.base)
        if self.named:
            parts.append(_options_in_name({name: self.options[name] for name in self.named}))
        return "-".join([*parts, *self._scales.values()])

    @property
    def command(self) -> str:
        """The command that trains it; omits the size of kinds with only one size."""
        has_one_size = len(latent_sizes(self.kind, self.task, self.options)) == 1
        size = "" if has_one_size else f" --latent {self.latents}"
        base = "" if self.base is None else f" --settings {self.base}"
        assigned = {} if self.features is None else {"features": ",".join(self.features)}
        assigned.update({name: _typed(self.options[name]) for name in self.named})
        assigned.update(self._scales)
        is_plain = self.kind == "dae" and not assigned and self.base is None
        verb = "train-dae" if is_plain else f"train-encoder --kind {self.kind}"
        settings = "".join(f" --set {name}={value}" for name, value in assigned.items())
        return f"jbench {verb} --task {self.task}{size}{base}{settings}"

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
        return {name: self.options[name] for name in _SCALES if name in self.options}


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

    given = {**({} if base is None else found.bases[base]), **options}
    made = make_kind(kind, given)
    if made.features is not None and made.needs_all_features:
        raise RequestError(f"{kind} needs all features of the observation: leave features out.")

    full = made.values
    if episodes is not None:
        length = find_task(task).episode_steps if mean_steps is None else mean_steps
        full = make_kind(kind, options_with_epochs(kind, given, episodes, length, seed)).values

    features = shortest(task, made.features)
    if features is None:
        full.pop("features", None)
    else:
        full["features"] = features

    # The name says where options come from, however they were typed.
    bases = (name for name, some in found.bases.items() if some.items() <= full.items())
    in_base = next(bases, None)
    elsewhere = {"features", *_SCALES, *(found.bases[in_base] if in_base else ())}
    changed = (name for name in given if name in full and name not in elsewhere)
    fields = found.model_fields
    named = [name for name in changed if full[name] != typed_default(fields[name])]

    return validated(
        EncoderSettings,
        "the encoder",
        kind=kind,
        task=task,
        seed=seed,
        options=full,
        base=in_base,
        named=sorted(named),
        sources=kind_sources(kind),
        **values,
    )


def named_encoder(name: str, task: str) -> EncoderSettings | None:
    """Returns settings that a representation asks for; None for other names, such as an id.

    Their options are those in the name, and their dataset and seed are not those of any. The name
    is KIND:LATENTS, KINDLATENTS, or KIND if the task determines the size; what is not the default
    follows, as in dae12-observation-whitened.

    Raises:
        RequestError: if there is no such kind, or its encoders don't have this size.
    """
    match = REPRESENTATION.fullmatch(name)
    kind = name.partition(":")[0] if match is None else match["kind"]
    if kind not in kind_names():
        if ":" not in name:
            return None
        if plugins.is_imported(name):
            raise RequestError(f"{name} is a kind of encoder; type the id of an encoder of it.")
    options = {} if match is None else _options_of_name(match, task)
    if options is None:
        return None

    sizes = latent_sizes(kind, task, options)
    latents = sizes[0] if len(sizes) == 1 and ":" not in name else 0
    if match and match["latents"]:
        latents = int(match["latents"].lstrip("0")[:10] or 0)  # Python reads no more than 4300
    problem = _wrong_size(kind, task, latents, options)
    if problem is None:
        base: EncoderBase | None = "script" if match and match["base"] else None
        return EncoderSettings(
            kind=kind,
            task=task,
            dataset="any",
            latents=latents,
            options=options,
            base=base,
            named=sorted(option for option in options if option not in ("features", *_SCALES)),
        )
    if not sizes:
        raise RequestError(f"{problem}.")
    size, more = ("", "") if len(sizes) == 1 else (str(min(12, sizes[-1])), ", for example")
    endings = match["endings"] if match else ""
    raise RequestError(f"{problem}; choose {kind}{size}{endings}{more}.")


def without_options(representation: str) -> str:
    """Returns a representation's name without its single options: dae12 of dae12-noise-0.2."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None or not match["options"]:
        return representation
    first, last = match.span("options")
    return representation[:first] + representation[last:]


def _options_of_name(match: re.Match[str], task: str) -> dict[str, Any] | None:
    """Returns the options in a name; None if they are a hash, whose encoder is found by the name.

    Raises a RequestError if the task has no such features.
    """
    options: dict[str, Any] = {name: match[name] for name in _SCALES if match[name]}
    features = match["features"]
    if features:
        if features.startswith(f"{HASHED}-"):
            return None
        options["features"] = shortest(task, from_name(features))
    for name, text in _OPTION.findall(match["options"] or ""):
        if name == _HASHED_OPTIONS:
            return None
        try:
            options[name] = json.loads(text)
        except ValueError:
            options[name] = text
    return options


def _options_in_name(options: Mapping[str, Any]) -> str:
    """Returns options as a part of a name: epochs-20-noise-0.2, or a hash of long ones."""
    name = "-".join(f"{option}-{_in_name(value)}" for option, value in options.items())
    return name if len(name) <= _LONGEST else f"{_HASHED_OPTIONS}-{settings_hash(options)}"


def _in_name(value: Any) -> str:
    """Returns a value as a part of a name, or its hash if it has other letters."""
    text = _typed(value)
    return text if re.fullmatch(r"[A-Za-z0-9_.]+", text) else settings_hash({"value": value})


def _typed(value: Any) -> str:
    """Returns a value as users type it, without an exponent."""
    if isinstance(value, float):
        return np.format_float_positional(value, trim="-")
    return value if isinstance(value, str) else json.dumps(value)


def _wrong_size(kind: str, task: str, latents: int, options: Mapping[str, Any]) -> str | None:
    """Returns what is wrong with a number of latents as a clause; None if nothing is."""
    sizes = latent_sizes(kind, task, options)
    if latents in sizes:
        return None
    if not sizes:
        return f"There is no {kind} encoder of {task}; choose dae, pca or forward"
    if len(sizes) == 1:
        return f"{kind} of {task} has {sizes[0]} latents"
    return f"A {kind} encoder of {task} has {sizes[0]} to {sizes[-1]} latents"
