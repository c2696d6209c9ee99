"""Environments of Gymnasium's registry: gym:ID, with arguments of `gymnasium.make`."""

import contextlib
import importlib
import json
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

import gymnasium

from jbench import plugins
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.sources import source_files
from jbench.task_specs import GYM
from jbench.typed_values import closest

_WRITTEN_IN_PYTHON = {"True": "true", "False": "false", "None": "null"}

_TYPED = re.compile(r"[\w.-]*(/[A-Za-z0-9][\w.-]*)*", re.ASCII)
"""A value that may be typed: parts of an id, or of a path, after a directory."""


@dataclass(frozen=True)
class RegisteredEnvironment:
    """An environment of the registry.

    Attributes:
        id: such as Pendulum-v1, or MODULE:ID for one that is registered when MODULE is imported.
        arguments: of `gymnasium.make`, by name.
        modules: names of the modules that implement and register it.
        entry_point: what makes it, or its name MODULE:NAME.
    """

    id: str
    arguments: Mapping[str, Any]
    modules: tuple[str, ...]
    entry_point: Any

    @property
    def description(self) -> str:
        """The first line of the docstring of a user's class or function.

        It is empty if that can't be imported: then it can't be made either, and `make` says why.
        """
        if not self.files:
            return ""

        entry = self.entry_point
        if isinstance(entry, str):
            try:
                entry = resolve_name(entry)
            except ERRORS_OF_OTHERS:
                return ""

        return plugins.first_line(entry)

    def make(self, **more: Any) -> gymnasium.Env[Any, Any]:
        """Returns a new environment with the wrappers of its registration, and more arguments."""
        arguments = {**self.arguments, **more}
        return gymnasium.make(self.id, **arguments)

    @property
    def files(self) -> dict[str, str]:
        """A checksum for each file of its code, see `source_files`; none for a library's."""
        return {
            name: checksum
            for module in self.modules
            for name, checksum in source_files(module).items()
        }


def find_environment(name: str) -> RegisteredEnvironment:
    """Returns the environment of a task such as gym:Pendulum-v1,g=9.8.

    Raises:
        RequestError: if there is none of this id, or an argument is not NAME=VALUE or given twice.
        WorkError: if the module that registers it fails.
    """
    id, *options = name.removeprefix(GYM).split(",")
    arguments = _arguments(name, options)
    registering, _, registered = id.rpartition(":")
    if registering:
        _register(name, registering)

    try:
        spec = gymnasium.spec(registered)
    except gymnasium.error.Error:
        raise _unknown_environment(id) from None

    entry = spec.entry_point
    if isinstance(entry, str):
        implementing = entry.partition(":")[0]
    else:
        implementing = getattr(entry, "__module__", "")

    modules = tuple(filter(None, dict.fromkeys((implementing, registering))))
    return RegisteredEnvironment(id, arguments, modules, entry)


def is_of_gymnasium(name: str) -> bool:
    """Returns whether a task is an environment that Gymnasium has, and no argument is a text.

    The task need not exist, and no module is imported.
    """
    id, *options = name.removeprefix(GYM).split(",")
    if not name.startswith(GYM) or ":" in id:
        return False

    try:
        entry = gymnasium.spec(id).entry_point
        values = _arguments(name, options).values()
    except (gymnasium.error.Error, RequestError):
        return False

    is_own = isinstance(entry, str) and entry.startswith(f"{gymnasium.__name__}.")
    return is_own and not any(isinstance(value, str) for value in values)


def _unknown_environment(id: str) -> RequestError:
    """Returns the error for an id, or MODULE:ID, that is not in Gymnasium's registry."""
    module, _, registered = id.rpartition(":")
    newest = {known.partition("-v")[0].lower(): known for known in gymnasium.registry}
    close = closest(registered.partition("-v")[0], list(newest))
    if close:
        meant = f"{GYM}{newest[close]}"
        if module and not is_of_gymnasium(meant):
            meant = f"{GYM}{module}:{newest[close]}"
        hint = f"did you mean {meant}?"
    elif module:
        hint = f"the module {module} has to register it when it is imported."
    else:
        hint = f"if a module of yours registers it, type {GYM}MODULE:{registered}."

    return RequestError(f"Gymnasium has no environment {registered}; {hint}")


def _arguments(name: str, options: Iterable[str]) -> dict[str, Any]:
    """Returns the arguments of `gymnasium.make` that are typed as NAME=VALUE, each once."""
    arguments: dict[str, Any] = {}
    for option in options:
        key, is_given, value = option.partition("=")
        if not key.isidentifier() or not is_given:
            raise RequestError(
                f"{name}: {option!r} is no argument of gymnasium.make; type NAME=VALUE after the "
                "comma."
            )

        if key in arguments:
            raise RequestError(f"{name} has the argument {key} twice; type it once.")

        arguments[key] = _value(name, key, value)

    return arguments


def _value(name: str, key: str, text: str) -> Any:
    """Returns the value of an argument of `gymnasium.make`: a number, true, false, null or text."""
    if not _TYPED.fullmatch(text):
        raise RequestError(
            f"{name}: the value of {key} becomes part of the names of runs, so it can't be a list "
            "or have other characters than letters, digits and ._-/; write a function that returns "
            "gymnasium.make(...), and type MODULE:NAME of it."
        )

    for read in (json.loads, float):
        with contextlib.suppress(ValueError):
            return read(text)

    if text in _WRITTEN_IN_PYTHON:
        raise RequestError(
            f"{name}: {key}={text} would be the text {text!r}; type {key}="
            f"{_WRITTEN_IN_PYTHON[text]}."
        )

    return text


def _register(name: str, module: str) -> None:
    """Imports the module that registers the environment of a task."""
    plugins.find_working_directory()
    try:
        importlib.import_module(module)
    except ERRORS_OF_OTHERS as error:
        if plugins.is_missing(module, error):
            if module.endswith(".py"):
                imported, where = plugins.module_in_file(module)
                typed = name.replace(module, imported, 1)
                raise RequestError(f"{name} has the path of a file; type {typed}{where}.") from None
            raise RequestError(
                f"{name}: there is no module {module}; install its package, or run jbench in the "
                "directory that contains the module."
            ) from None
        raise WorkError(
            f"The module {module} of {name} can't be imported ({sentence_of_failure(error)})."
        ) from error


def files_at_hand(recorded: Iterable[str]) -> dict[str, str]:
    """Returns a checksum for each present file of an environment's code; {} if there are none.

    Its modules are found by the names of the recorded files, and not imported: only an import would
    tell which module implements an environment, and anyone may have recorded its name.
    """
    plugins.find_working_directory()
    found = dict[str, str]()
    for file in recorded:
        module, elsewhere = plugins.module_in_file(file)
        if file.endswith(".py") and not elsewhere and file not in found:
            found |= source_files(module)

    return found


def code_provenance(name: str) -> dict[str, Any]:
    """Returns provenance of the code of an environment that was made, as that of `plugins`."""
    environment = find_environment(name)
    made: dict[str, Any] = {}
    for module in reversed(environment.modules):
        if module in sys.modules:
            made |= plugins.where_from(module)
    return {**made, "sources": environment.files} if environment.files else made
