"""Help as plain text: commands and options under headings, and placeholders such as N and DIR."""

from itertools import groupby
from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperGroup

_MAIN = {"train": ("task", "algo", "encoder", "seeds", "steps")}
"""Options of a command that everybody needs; its other ones are listed under "Advanced"."""

_PLACEHOLDERS: dict[Any, str] = {int: "N", float: "N", Path: "PATH", list[Path]: "PATH"}
_NAMED = {
    **dict.fromkeys(("results", "directories", "others"), "DIR"),
    **{"files": "FILE", "steps": "STEPS", "evaluate_every": "STEPS"},
}


class GroupedCommands(TyperGroup):
    """Commands listed under the headings that `rich_help_panel` gives them, as plain text."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Writes a section for each heading."""
        commands = [self.commands[name] for name in self.list_commands(ctx)]
        shown = [c for c in commands if isinstance(c, TyperCommand) and not c.hidden]
        width = max(len(str(command.name)) for command in shown)
        for heading, group in groupby(shown, lambda command: command.rich_help_panel):
            rows = [
                (str(command.name).ljust(width), command.get_short_help_str(formatter.width))
                for command in group
            ]
            with formatter.section(heading):
                formatter.write_dl(rows)


class Command(TyperCommand):
    """A command whose help lists its main options first."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Gives a placeholder to each parameter without one."""
        super().__init__(*arguments, **options)
        for parameter in self.params:
            if parameter.metavar is None and not getattr(parameter, "is_flag", False):
                parameter.metavar = _placeholder(parameter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Returns the parts of the usage line; a required argument has no braces."""
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Writes the arguments, the main options and the others."""
        parameters = {str(each.name): each for each in self.get_params(ctx)}
        main = [parameters.pop(name) for name in _MAIN.get(str(self.name), ())]
        others = [each for each in parameters.values() if each.param_type_name == "option"]
        arguments = [each for each in parameters.values() if each.param_type_name == "argument"]
        for heading, group in (
            ("Arguments", arguments),
            ("Options", main or others),
            ("Advanced", others if main else []),
        ):
            # typer adds the type to the name of an argument.
            records = [
                (each.metavar or record[0], record[1]) if group is arguments else record
                for each in group
                if (record := each.get_help_record(ctx)) is not None
            ]
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def _placeholder(parameter: Any) -> str:
    """Returns what stands for a parameter's value, such as N, DIR or STEPS."""
    if parameter.name in _NAMED:
        return _NAMED[parameter.name]
    name = parameter.name.rstrip("_").rpartition("_")[2].upper()
    placeholder: str = _PLACEHOLDERS.get(parameter.type_descriptor.annotation, name)
    return placeholder
