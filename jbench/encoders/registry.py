"""Registry of the kinds of encoders: built-in ones and those of other packages.

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
from jbench.errors import WorkError
from jbench.names import ENCODER_KINDS, OFE, known
from jbench.settings.base import settings_with

GROUP = "jbench.encoders"

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
    known("kind of encoder", name, kind_names())
    if name in ENCODER_KINDS:
        module, _, attribute = ENCODER_KINDS[name].partition(":")
        kind: Any = getattr(importlib.import_module(module), attribute)
    else:
        kind = plugins.load("kind of encoder", _offered()[name])
    if not (isinstance(kind, type) and issubclass(kind, (ClosedForm, Fitted, Learned))):
        raise WorkError(
            f"The kind of encoder {name} is no subclass of Learned, ClosedForm or Fitted of "
            "jbench.encoders.kind; fix it, or uninstall the package that offers it."
        )
    return kind


def only_size(kind: str, task: str) -> int | None:
    """Returns the number of latents of a kind if the task determines it, else None.

    Raises:
        RequestError, WorkError: see `find_kind`.
    """
    sizes = find_kind(kind).latent_sizes(task)
    return sizes[0] if len(sizes) == 1 else None


def make_kind(name: str, options: Mapping[str, Any]) -> Kind:
    """Returns a kind with the given options.

    Raises:
        RequestError: if the kind or an option does not exist, or a value is invalid.
    """
    return settings_with(find_kind(name), name, options, "option")


def _offered() -> dict[str, EntryPoint]:
    """Returns the valid entry points of other packages by name."""
    return plugins.offered(GROUP, _NAME, {*ENCODER_KINDS, OFE})
