"""Help that lists the commands under headings."""

from itertools import groupby
from typing import Any

from typer.core import TyperCommand, TyperGroup


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
