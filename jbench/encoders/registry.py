"""Kinds of encoders by name: built-in ones, those of other packages, and MODULE:CLASS.

A package registers a kind by an entry point of the group `jbench.encoders`, named after the kind,
and whose value is its class; see `docs/your-own-encoder.md`.
"""

import importlib
import re
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from typing import Any

from jbench import plugins
from jbench.encoders.kind import ClosedForm, Fitted, Kind, Learned
from jbench.errors import RequestError, WorkError
from jbench.names import ENCODER_KINDS, OFE, known
from jbench.settings.base import settings_with

GROUP = "jbench.encoders"

_WHAT = "kind of encoder"

# A representation is a kind and a number, such as dae12, so a kind must not end in a digit.
_NAME = re.compile(r"[a-z]([a-z0-9-]*[a-z])?")


def kind_names() -> list[str]:
    """Returns the names of all kinds, built-in ones first."""
    return [*ENCODER_KINDS, *sorted(_offered())]


def find_kind(name: str) -> type[Kind]:
    """Returns the class of a kind.

    Raises:
        RequestError: if the kind does not exist.
        WorkError: if its package can't be imported, or its class is not a kind.
    """
    if name in ENCODER_KINDS:  # looking for those of other packages takes milliseconds
        module, _, attribute = ENCODER_KINDS[name].partition(":")
        kind: Any = getattr(importlib.import_module(module), attribute)
    elif plugins.is_imported(name):
        kind = plugins.imported(_WHAT, name)
    else:
        kind = plugins.load(_WHAT, _offered()[known(_WHAT, name, (*kind_names(), "MODULE:CLASS"))])
    if not (isinstance(kind, type) and issubclass(kind, (ClosedForm, Fitted, Learned))):
        raise WorkError(
            f"The kind of encoder {name} is no subclass of Learned, ClosedForm or Fitted of "
            "jbench.encoders.kind; fix it, or uninstall the package that offers it."
        )
    return kind


def short_name(kind: str) -> str:
    """Returns the name of a kind in representations: that of FirstFeatures is first-features.

    Raises:
        RequestError: if MODULE:CLASS gives the name of another kind, or one that ends in a digit.
    """
    if not plugins.is_imported(kind):
        return kind
    words = re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", kind.partition(":")[2])
    name = "-".join(words).lower()
    if _NAME.fullmatch(name) and name not in (*kind_names(), OFE):
        return name
    taken = "is that of another kind" if name in kind_names() else "must not end in a digit"
    raise RequestError(f"{kind}: the name {name!r} {taken}; give the class another name.")


def code_provenance(kind: str) -> dict[str, str | None]:
    """Returns provenance of the code of a kind; none for those of jbench."""
    return {} if kind in ENCODER_KINDS else plugins.provenance(_WHAT, kind, _offered())


def latent_sizes(kind: str, task: str) -> range:
    """Returns the allowed numbers of latents of a kind; none if it is the Jitterbug's only.

    Raises:
        RequestError, WorkError: see `find_kind`.
    """
    try:
        return find_kind(kind).latent_sizes(task)
    except KeyError:  # it looks up the features of one of the five tasks
        return range(0)


def wrong_size(kind: str, task: str, latents: int) -> str | None:
    """Returns what is wrong with a number of latents, as the beginning of a sentence, if any."""
    sizes = latent_sizes(kind, task)
    if latents in sizes:
        return None
    if not sizes:
        return f"There is no {kind} encoder of {task}"
    if len(sizes) == 1:
        return f"{kind} of {task} has {sizes[0]} latents"
    return f"A {kind} encoder of {task} has {sizes[0]} to {sizes[-1]} latents"


def make_kind(name: str, options: Mapping[str, Any]) -> Kind:
    """Returns a kind with the given options.

    Raises:
        RequestError: if the kind or an option does not exist, or a value is invalid.
    """
    return settings_with(find_kind(name), name, options, "option")


def _offered() -> dict[str, EntryPoint]:
    """Returns the valid entry points of other packages by name."""
    return plugins.offered(GROUP, _NAME, {*ENCODER_KINDS, OFE})
