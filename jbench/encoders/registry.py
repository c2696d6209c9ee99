"""Kinds of encoders by name.

Kinds are built-in ones, those of other packages, and MODULE:CLASS. A package registers a kind by an
entry point of the group `jbench.encoders`; see `docs/your-own-encoder.md`.
"""

import contextlib
import math
import pkgutil
import re
from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint
from typing import Any

import torch

from jbench import plugins
from jbench.encoders.features import columns
from jbench.encoders.kind import Fitted, Kind, Learned
from jbench.encoders.states import split_episodes
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.representation_names import ENCODER_KINDS, OFE
from jbench.settings.base import settings_with
from jbench.sources import checksum
from jbench.store import Record
from jbench.store.code import with_data_read
from jbench.typed_values import known

_NOUN = "kind of encoder"

# A representation is a kind and a number, such as dae12, so a kind must not end in a digit.
_NAME = re.compile(r"[a-z]([a-z0-9-]*[a-z])?")

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
        RequestError: if the kind does not exist, or what MODULE:CLASS names is not a kind.
        WorkError: if its package can't be imported, or offers something else.
    """
    if name in ENCODER_KINDS:  # looking for those of other packages takes milliseconds
        kind = pkgutil.resolve_name(ENCODER_KINDS[name])
    elif plugins.is_imported(name):
        kind = plugins.imported(_NOUN, name)
    else:
        plugins.refuse_path(name)
        name_offered = known(_NOUN, name, (*kind_names(), "MODULE:CLASS"))
        kind = plugins.load(_NOUN, offered_kinds()[name_offered])

    if isinstance(kind, type) and issubclass(kind, (Fitted, Learned)):
        return kind

    kind_class = kind if isinstance(kind, type) else type(kind)
    if issubclass(kind_class, torch.nn.Module):
        raise RequestError(
            f"{name} is a torch module. Beside it, write a subclass of TorchEncoder of "
            "jbench.encoders.pretrained, whose methods return the module and its trained "
            "state_dict, and type the name of that class; docs/your-own-encoder.md has an example."
        )

    if plugins.is_imported(name):
        raise RequestError(
            f"{name} is not a kind of encoder: make it a subclass of Fitted or Learned of "
            "jbench.encoders.kind; docs/your-own-encoder.md has an example of each."
        )

    raise WorkError(
        f"The kind of encoder {name} is no subclass of Learned or Fitted of "
        "jbench.encoders.kind; fix it, or uninstall the package that offers it."
    )


def make_kind(name: str, options: Mapping[str, Any]) -> Kind:
    """Returns a kind with the given options; a RequestError if one does not exist or is invalid."""
    return settings_with(find_kind(name), name, options, "option")


def kind_provenance(kind: str) -> dict[str, Any]:
    """Returns provenance of the code of a kind; none for those of jbench."""
    if kind in ENCODER_KINDS:
        return {}
    return plugins.code_provenance(_NOUN, kind, offered_kinds())


def present_code(encoder: Record) -> dict[str, Any]:
    """Returns provenance of the present code of a recorded encoder's kind; see `with_data_read`."""
    code = kind_provenance(str(encoder.settings.get("kind")))
    return with_data_read(code, encoder.manifest.provenance)


def description(kind: str) -> str:
    """Returns the first line of the docstring of a user's kind; "" for those of jbench."""
    if kind in ENCODER_KINDS:
        return ""
    return plugins.first_line(find_kind(kind))


def kind_sources(kind: str) -> str | None:
    """Returns the checksum of the code of a kind; None for those of jbench."""
    return checksum(kind_provenance(kind).get("sources", {}))


def latent_sizes(kind: str, task: str, options: Mapping[str, Any] | None = None) -> range:
    """Returns the allowed numbers of latents of a kind; none if it is the Jitterbug's only.

    Raises:
        RequestError: if the kind, its task, or one of the options or features does not exist.
        WorkError: if a method of a kind of another package fails.
    """
    made = make_kind(kind, options or {})
    count = len(columns(task, made.features))
    with sentence_about(kind, "latent_sizes or encode"):
        return made.latent_sizes(task, count)


@contextlib.contextmanager
def sentence_about(kind: str, method: str) -> Iterator[None]:
    """Turns an error of a method of a kind of another package into a sentence: a WorkError.

    Those of jbench's kinds are faults of jbench, and stay as they are.
    """
    if kind in ENCODER_KINDS:
        yield
        return

    try:
        yield
    except (RequestError, WorkError):
        raise
    except NotImplementedError:
        reason = f"it has no method {method}"
    except ERRORS_OF_OTHERS as error:
        reason = f"{method} fails ({sentence_of_failure(error)})"
    else:
        return

    raise WorkError(
        f"The kind of encoder {kind} can't be used: {reason}; docs/your-own-encoder.md describes "
        "the methods."
    )


def options_with_epochs(
    kind: str, options: Mapping[str, Any], episodes: int, episode_steps: float, seed: int
) -> dict[str, Any]:
    """Returns options with a number of epochs that suits the size of the dataset.

    The default of a kind is meant for the paper's 5,000 episodes. A small dataset has few batches,
    so it is given more epochs: as many as `MIN_UPDATES` need. Epochs that are given stay.
    """
    made = make_kind(kind, options)
    if "epochs" in options or not isinstance(made, Learned):
        return dict(options)
    learned = split_episodes(episodes, seed).learned
    batches = math.ceil(len(learned) * episode_steps / made.batch)
    return {**options, "epochs": max(made.epochs, math.ceil(MIN_UPDATES / batches))}


def short_name(kind: str) -> str:
    """Returns the name of a kind in representations: that of FirstFeatures is first-features."""
    if not plugins.is_imported(kind):
        return kind
    words = re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", kind.partition(":")[2])
    name = "-".join(words).lower()
    if _NAME.fullmatch(name) and name not in (*kind_names(), OFE):
        return name

    problem = "must not end in a digit"
    if name in kind_names():
        problem = "is that of another kind"
    raise RequestError(f"{kind}: the name {name!r} {problem}; give the class another name.")


def offered_kinds() -> dict[str, EntryPoint]:
    """Returns the entry points of the kinds of other packages by name."""
    return plugins.offered("jbench.encoders", _NAME, {*ENCODER_KINDS, OFE})
