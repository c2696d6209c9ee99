"""The command leaderboard: algorithms and representations of several results, ranked."""

from pathlib import Path

from typer import Argument, Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.errors import RequestError
from jbench.report.request import Request
from jbench.settings.base import validated


def leaderboard(
    directories: list[Path] = Argument(
        None,
        parser=parsing.path,
        metavar="DIR",
        help="Results directories, of which reference is the shipped one (default: --results).",
    ),
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    markdown: bool = Option(False, "--markdown", help="Print Markdown to standard output."),
    as_csv: bool = options.CSV,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
    returns: names.ReturnsName = Option(
        "evaluation",
        help="Returns that rank the entries: evaluation (deterministic policy) or training "
        "(exploration included).",
    ),
) -> None:
    """Rank algorithms and representations on each task.

    An entry shares the rank of the one above it, unless its interval lies below that of the first
    entry of this rank.
    """
    if [markdown, as_csv, json].count(True) > 1:
        raise RequestError("--markdown, --csv and --json exclude each other; type one of them.")

    from jbench.report.leaderboard import ranked_configurations
    from jbench.report.table import to_csv, to_markdown
    from jbench.report.tables import leaderboard_table
    from jbench.store.query import records

    if directories and results != Path(names.RESULTS):
        raise RequestError("--results and DIR exclude each other; type the directories alone.")

    named = [parsing.results_to_read(directory) for directory in directories or [results]]
    # A directory may be typed twice, also by two paths.
    read = list({database.path.resolve(): database for database in named}.values())
    databases = {str(database.name): database for database in read}
    if algo not in (None, names.HEURISTIC):
        algo = parsing.known_or_held("algo", algo, read)

    request = validated(
        Request,
        "the leaderboard",
        task=task and parsing.known_or_held("task", task, read),
        algo=() if algo is None else (algo,),
        returns=returns,
    )
    ranked, problems = ranked_configurations(databases, request)
    table = leaderboard_table(ranked, request.returns)
    if markdown:
        output.raw(to_markdown(table))
    elif as_csv:
        output.raw(to_csv(ranked))
    else:
        output.frame(table.title, table.texts(), table.spare)
        output.say(table.caption)

    output.document({"entries": records(ranked), "problems": problems})
    output.warn_of_damage(problems)
