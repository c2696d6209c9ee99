"""The verbs of the command line, each imported when it is called.

Help and completion of their names need only the first lines of their docstrings, which are read
from the source, so that neither imports the settings of all verbs.
"""

import ast
import importlib
import importlib.util
import inspect
from collections import UserDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup


@dataclass(frozen=True)
class Verb:
    """A verb: what a user types, and the function that it calls.

    Attributes:
        example: a command line without `jbench`; its first word is the verb.
        function: `MODULE:NAME` in jbench.commands.
        heading: of the list in which the help shows it.
        summary: in place of the first line of the function's docstring.
        hidden: whether the help leaves it out.
    """

    example: str
    function: str
    heading: str
    summary: str | None = None
    hidden: bool = False

    @property
    def name(self) -> str:
        """The verb as typed."""
        return self.example.split()[0]

    @cached_property
    def command(self) -> Any:
        """The command with its options; imports its module."""
        module, _, name = self.function.partition(":")
        function = getattr(importlib.import_module(f"jbench.commands.{module}"), name)
        app = typer.Typer(add_completion=False, rich_markup_mode="rich")
        register = app.command(
            self.name,
            cls=Command,
            help=self.summary or _paragraphs(function.__doc__),
            epilog=f"Example: jbench {self.example}",
            rich_help_panel=self.heading,
            hidden=self.hidden,
        )
        register(function)
        return typer.main.get_command(app)

    @property
    def line(self) -> TyperCommand:
        """The command without its options, as the help lists it; imports nothing."""
        module, _, name = self.function.partition(":")
        return TyperCommand(
            self.name,
            help=self.summary or _docstrings(module)[name],
            rich_help_panel=self.heading,
            hidden=self.hidden,
        )


PLACEHOLDERS = {
    "--augment": "SEED",
    "--from": "FORMAT",
    "--log": "TRACKER",
    "--seed-from": "REGEX",
    "--since": "DATE",
    "--window": "EPISODES",
}
"""Placeholders of the values of flags whose last word says something else."""


@cache
def _docstrings(module: str) -> dict[str, str]:
    """Returns the docstrings of the functions of a module of jbench.commands."""
    spec = importlib.util.find_spec(f"jbench.commands.{module}")
    assert spec is not None
    assert spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text("utf-8"))
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return {node.name: ast.get_docstring(node) or "" for node in functions}


def _paragraphs(docstring: str) -> str:
    """Returns a docstring whose paragraphs have a line each, for the terminal to break."""
    paragraphs = inspect.cleandoc(docstring).split("\n\n")
    return "\n\n".join(" ".join(paragraph.splitlines()) for paragraph in paragraphs)


class Command(TyperCommand):
    """A command whose help has placeholders such as SEEDS instead of types."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Returns the parameters, --help included."""
        return _with_placeholders(super().get_params(ctx))


class Verbs(TyperGroup):
    """The group of all verbs; a subclass has them by name."""

    verbs: ClassVar[Mapping[str, Verb]] = {}

    def __init__(self, **options: Any) -> None:
        """Makes no command yet."""
        super().__init__(**options)
        self.commands = _Commands(self.verbs)
        self._is_listed = False

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Returns a command, or None; while all are listed, one without its options."""
        if self._is_listed:
            return self.verbs[cmd_name].line
        return self.commands.get(cmd_name)

    def list_commands(self, ctx: Any) -> list[str]:
        """Returns the verbs."""
        return list(self.verbs)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Writes the help."""
        with self._listing():
            super().format_help(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Returns the verbs and options that begin so."""
        with self._listing():
            return super().shell_complete(ctx, incomplete)

    def get_params(self, ctx: Any) -> list[Any]:
        """Returns the parameters, --help included."""
        return _with_placeholders(super().get_params(ctx))

    @contextmanager
    def _listing(self) -> Iterator[None]:
        """While it lasts, commands are listed without being imported."""
        self._is_listed = True
        try:
            yield
        finally:
            self._is_listed = False


class _Commands(UserDict[str, Any]):
    """The commands of verbs by name, each made when it is read."""

    def __getitem__(self, name: str) -> Any:
        """Imports the command of a verb."""
        return super().__getitem__(name).command


def _with_placeholders(parameters: list[Any]) -> list[Any]:
    """Returns parameters with placeholders such as SEEDS; flags, which take no value, have none."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        elif parameter.metavar is None:
            flag = parameter.opts[0]
            parameter.metavar = PLACEHOLDERS.get(flag, flag.rpartition("-")[2].upper())
        if isinstance(parameter, TyperArgument):  # beside which typer shows a type of Python
            parameter.display_type_rich = _no_type  # type: ignore[method-assign]
    return parameters


def _no_type(ctx: Any) -> None:
    """Shows nothing."""
