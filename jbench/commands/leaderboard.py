"""The leaderboard command."""

from pathlib import Path
from typing import Annotated

import typer

from jbench import names
from jbench.commands import parsing
from jbench.commands.options import (
    RESULTS,
    CsvOption,
    JsonOption,
    OneAlgorithmOption,
    OneTaskOption,
    ReadResultsOption,
    complete,
    path,
)
from jbench.commands.output import Output
from jbench.errors import RequestError


def leaderboard(
    directories: Annotated[
        list[Path] | None,
        typer.Argument(
            parser=path,
            help="Results directories, of which reference is the shipped one (default: --results).",
        ),
    ] = None,
    task: OneTaskOption = None,
    algo: OneAlgorithmOption = None,
    returns: Annotated[
        str,
        typer.Option(
            help="Returns to rank by: evaluation (deterministic policy) or training (exploration "
            "included).",
            autocompletion=complete(*names.RETURNS),
        ),
    ] = "evaluation",
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print Markdown to standard output.")
    ] = False,
    as_csv: CsvOption = False,
    results: ReadResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Rank algorithms and representations on each task.

    Entries whose intervals overlap share a rank.
    """
    if markdown + as_csv + json > 1:
        raise RequestError("--markdown, --csv and --json exclude each other; type one of them.")
    from jbench.commands.display import show_item
    from jbench.report import leaderboard as board
    from jbench.report.data.returns import KINDS
    from jbench.report.request import Request
    from jbench.report.tables.files import FORMATS

    found = [parsing.existing_results(directory) for directory in directories or [results]]
    # A directory may be typed twice, also by two paths.
    read = list({one.path.resolve(): one for one in found}.values())
    databases = {str(one.name): one for one in read}
    request = Request(
        task=task and parsing.known_or_held("task", task, read),
        algo=algo if algo in (None, names.HEURISTIC) else parsing.known_or_held("algo", algo, read),
        returns=names.known("value of --returns", returns, names.RETURNS),
    )
    ranked, problems = board.of_results(databases, request)
    output, item = Output(json), board.table(ranked, KINDS[request.returns])
    if markdown or as_csv:
        output.raw(FORMATS["md" if markdown else "csv"](item))
    else:
        show_item(item, output)
        output.say(item.caption)
    output.document({"entries": board.documents(ranked), "problems": problems})
    output.warn_of_damage(problems)
