"""Kinds of encoders by name, and the settings that identify an encoder.

Kinds are built-in ones, those of other packages, and MODULE:CLASS. A package registers a kind by an
entry point of the group `jbench.encoders`; see `docs/your-own-encoder.md`.
"""

import math
import pkgutil
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint
from typing import Any

from pydantic import Field, model_validator

from jbench import plugins
from jbench.encoders.features import HASHED, columns, from_name, in_name, shortest
from jbench.encoders.kind import Fitted, Kind, Learned
from jbench.encoders.states import split_episodes
from jbench.errors import RequestError, WorkError
from jbench.names import ENCODER_KINDS, EPISODE_STEPS, OFE, REPRESENTATION, EncoderBase, known
from jbench.settings.base import (
    Seed,
    Settings,
    in_id,
    omissible,
    settings_hash,
    settings_with,
    validated,
)
from jbench.sources import checksum

_WHAT = "kind of encoder"

# A representation is a kind and a number, such as dae12, so a kind must not end in a digit.
_NAME = re.compile(r"[a-z]([a-z0-9-]*[a-z])?")

_SCALES = ("scale", "rescale")  # options of every kind that are part of a representation's name

MIN_UPDATES = 4000
"""Fewest updates of an encoder whose number of epochs is not given.

With 20,000 control steps, `dae12` then explains 0.88 of the variance on held-out episodes of
`face_direction`; in 200 epochs, 0.67.
"""


def kind_names() -> list[str]:
    """Returns the names of all kinds, built-in ones first."""
    return [*ENCODER_KINDS, *sorted(offered_kinds())]


def find_kind(name: str) -> type[Kind]:
    """Returns the class of a kind.

    Raises:
        RequestError: if the kind does not exist.
        WorkError: if its package can't be imported, or its class is not a kind.
    """
    if name in ENCODER_KINDS:  # looking for those of other packages takes milliseconds
        kind = pkgutil.resolve_name(ENCODER_KINDS[name])
    elif plugins.is_imported(name):
        kind = plugins.imported(_WHAT, name)
    else:
        kind = plugins.load(
            _WHAT, offered_kinds()[known(_WHAT, name, (*kind_names(), "MODULE:CLASS"))]
        )
    if not (isinstance(kind, type) and issubclass(kind, (Fitted, Learned))):
        raise WorkError(
            f"The kind of encoder {name} is no subclass of Learned or Fitted of "
            "jbench.encoders.kind; fix it, or uninstall the package that offers it."
        )
    return kind


def make_kind(name: str, options: Mapping[str, Any]) -> Kind:
    """Returns a kind with the given options; a RequestError if one does not exist or is invalid."""
    return settings_with(find_kind(name), name, options, "option")


def code_provenance(kind: str) -> dict[str, Any]:
    """Returns provenance of the code of a kind; none for those of jbench."""
    return {} if kind in ENCODER_KINDS else plugins.provenance(_WHAT, kind, offered_kinds())


def kind_sources(kind: str) -> str | None:
    """Returns the checksum of the code of a kind; None for those of jbench."""
    return checksum(code_provenance(kind).get("sources", {}))


def latent_sizes(kind: str, task: str, features: Sequence[str] | None = None) -> range:
    """Returns the allowed numbers of latents of a kind; none if it is the Jitterbug's only.

    Raises a RequestError if the task or one of the chosen features does not exist.
    """
    count = len(columns(task, features))
    try:
        return find_kind(kind).latent_sizes(task, count)
    except KeyError:  # it looks up the features of one of the five tasks
        return range(0)


class EncoderSettings(Settings):
    """Settings that identify an encoder."""

    kind: str = "dae"
    task: str = "face_direction"
    dataset: str = Field(description="id of the random-policy dataset")
    latents: int = Field(default=12, ge=1, description="paper, Figures 7 and 8")
    seed: Seed = 0
    options: dict[str, Any] = Field(default_factory=dict, description="every option of the kind")
    base: EncoderBase | None = omissible(None, description="source of the options, if in the name")
    sources: str | None = omissible(
        None, description="checksum of the code of a kind that is not jbench's"
    )

    @model_validator(mode="after")
    def _has_a_size_of_its_kind(self) -> "EncoderSettings":
        features = self.options.get("features")
        problem = _wrong_size(self.kind, self.task, self.latents, features)
        if problem is not None:
            possible = latent_sizes(self.kind, self.task, features)
            raise ValueError(f"{problem}, not {self.latents}" if possible else problem)
        return self

    @property
    def representation(self) -> str:
        """Name of its latents, such as dae12-whitened: kind, size, and what is not the default."""
        name = f"{short_name(self.kind)}{self.latents}"
        features = self.options.get("features")
        endings = [] if features is None else [in_name(features)]
        if self.base is not None:
            endings.append(self.base)
        return "-".join([name, *endings, *self._scales.values()])

    @property
    def command(self) -> str:
        """The command that trains it; omits the size of kinds with only one size."""
        features = self.options.get("features")
        has_one_size = len(latent_sizes(self.kind, self.task, features)) == 1
        size = "" if has_one_size else f" --latent {self.latents}"
        base = "" if self.base is None else f" --settings {self.base}"
        assigned = {} if features is None else {"features": ",".join(features)}
        assigned.update(self._scales)
        is_plain = self.kind == "dae" and not assigned and self.base is None
        verb = "train-dae" if is_plain else f"train-encoder --kind {self.kind}"
        settings = "".join(f" --set {name}={value}" for name, value in assigned.items())
        return f"jbench {verb} --task {self.task}{size}{base}{settings}"

    @property
    def columns(self) -> list[int] | None:
        """Which values of the observation it encodes, in order; None for all."""
        features = self.options.get("features")
        return None if features is None else columns(self.task, features)

    @property
    def _scales(self) -> dict[str, str]:
        return {name: self.options[name] for name in _SCALES if name in self.options}

    @property
    def id(self) -> str:
        """The encoder's id, such as face_direction/dae12/s00-1f9a2c4e."""
        return f"{in_id(self.task)}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def draws(self) -> str:
        """A hash that is equal for encoders that differ only in their seeds."""
        return settings_hash(self.model_dump(mode="json", exclude={"seed"}))


def encoder_settings(
    kind: str,
    options: Mapping[str, Any],
    *,
    task: str = "face_direction",
    base: EncoderBase | None = None,
    **values: Any,
) -> EncoderSettings:
    """Returns the settings of an encoder with every option of its kind.

    Args:
        options: those that are not the defaults, or not those of the base.
        base: see `Kind.bases`.
        values: of the other settings.

    Raises:
        RequestError: if an option, one of its values, a feature or the base does not exist.
    """
    found = find_kind(kind)
    if base is not None and base not in found.bases:
        raise RequestError(
            f"The settings of the {base} are for dae, not for {kind}: leave them out."
        )
    named = {} if base is None else found.bases[base]
    made = make_kind(kind, {**named, **options})
    if made.features is not None and made.needs_all_features:
        raise RequestError(f"{kind} needs all features of the observation: leave features out.")

    full = made.model_dump(mode="json")
    features = shortest(task, made.features)
    if features is None:
        full.pop("features", None)
    else:
        full["features"] = features
    # The name says where the options come from, however they were typed.
    source = next(
        (name for name, some in found.bases.items() if some.items() <= full.items()), None
    )
    about = {"kind": kind, "task": task, "options": full, "base": source}
    about["sources"] = kind_sources(kind)
    return validated(EncoderSettings, "the encoder", **about, **values)


def options_with_epochs(
    kind: str, options: Mapping[str, Any], episodes: int, seed: int
) -> dict[str, Any]:
    """Returns options with a number of epochs that suits the size of the dataset.

    The default of a kind is meant for the paper's 5,000 episodes. A small dataset has few batches,
    so it is given more epochs: as many as `MIN_UPDATES` need. Epochs that are given stay.
    """
    made = make_kind(kind, options)
    if "epochs" in options or not isinstance(made, Learned):
        return dict(options)
    learned, _ = split_episodes(episodes, seed)
    batches = math.ceil(len(learned) * EPISODE_STEPS / made.batch)
    return {**options, "epochs": max(made.epochs, math.ceil(MIN_UPDATES / batches))}


def named_encoder(name: str, task: str) -> EncoderSettings | None:
    """Returns settings that a representation asks for; None for other names, such as an id.

    Their options are the scales in the name, and their dataset and seed are not those of any. The
    name is KIND:LATENTS, KINDLATENTS, or KIND if the task determines the size; scales that are not
    the defaults follow, as in dae12-observation-whitened.

    Raises:
        RequestError: if there is no such kind, or its encoders don't have this size.
    """
    match = REPRESENTATION.fullmatch(name)
    kind = name.partition(":")[0] if match is None else match["kind"]
    if kind not in kind_names():
        if ":" not in name:
            return None
        if plugins.is_imported(name):
            short = f"{short_name(name)}12"
            raise RequestError(f"{name} is a class; type --encoder {short}, for example.")
    options: dict[str, Any] = {}
    base: EncoderBase | None = None
    if match:
        options = {option: match[option] for option in _SCALES if match[option]}
        base = "script" if match["base"] else None
        if match["features"]:
            if match["features"].startswith(f"{HASHED}-"):
                return None  # found by the whole name
            options["features"] = shortest(task, from_name(match["features"]))
    sizes = latent_sizes(kind, task, options.get("features"))
    latents = sizes[0] if len(sizes) == 1 and ":" not in name else 0
    if match and match["latents"]:
        latents = int(match["latents"].lstrip("0")[:10] or 0)  # Python reads no more than 4300
    problem = _wrong_size(kind, task, latents, options.get("features"))
    if problem is None:
        return EncoderSettings(
            kind=kind, task=task, dataset="any", latents=latents, options=options, base=base
        )
    if not sizes:
        raise RequestError(f"{problem}.")
    size, more = ("", "") if len(sizes) == 1 else (str(min(12, sizes[-1])), ", for example")
    endings = match["endings"] if match else ""
    raise RequestError(f"{problem}; choose {kind}{size}{endings}{more}.")


def short_name(kind: str) -> str:
    """Returns the name of a kind in representations: that of FirstFeatures is first-features."""
    if not plugins.is_imported(kind):
        return kind
    words = re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", kind.partition(":")[2])
    name = "-".join(words).lower()
    if _NAME.fullmatch(name) and name not in (*kind_names(), OFE):
        return name
    taken = "is that of another kind" if name in kind_names() else "must not end in a digit"
    raise RequestError(f"{kind}: the name {name!r} {taken}; give the class another name.")


def _wrong_size(kind: str, task: str, latents: int, features: Sequence[str] | None) -> str | None:
    """Returns what is wrong with a number of latents as a clause; None if nothing is."""
    sizes = latent_sizes(kind, task, features)
    if latents in sizes:
        return None
    if not sizes:
        return f"There is no {kind} encoder of {task}; choose dae, pca or forward"
    if len(sizes) == 1:
        return f"{kind} of {task} has {sizes[0]} latents"
    return f"A {kind} encoder of {task} has {sizes[0]} to {sizes[-1]} latents"


def offered_kinds() -> dict[str, EntryPoint]:
    """Returns the entry points of the kinds of other packages by name."""
    return plugins.offered("jbench.encoders", _NAME, {*ENCODER_KINDS, OFE})
