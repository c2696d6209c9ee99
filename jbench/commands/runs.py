"""Commands that list runs: runs, tail, leaderboard."""

import json as json_format
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from typer import Argument, Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.errors import RequestError, WorkError
from jbench.report.numbers import Form, whole
from jbench.report.request import Request
from jbench.settings.base import validated
from jbench.wording import are, counted, duration, progress_text, repair_hint

if TYPE_CHECKING:
    from jbench.store.follow import Change
    from jbench.store.rows import Row
    from jbench.store.run_line import RunLine


_SPARE = ("created", "wall time", "returns", "episodes", "points", "steps", "status", "variant")
"""Columns that `runs` leaves out on a narrow terminal, the first one first."""


def runs(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    representation: str | None = options.ONE_REPRESENTATION,
    status: names.Status | None = options.ONE_STATUS,
    seed: str | None = options.SOME_SEEDS,
    returns: bool = Option(
        False,
        "--returns",
        help="Show final returns (reads all episodes); quote that of the evaluation.",
    ),
    failed: bool = Option(False, "--failed", help="List the runs that failed, with their errors."),
    imports: bool = Option(False, "--imports", help="List imported learning curves, not runs."),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """List runs with their status, progress and wall time.

    The oldest run comes first.
    """
    from jbench.store.listing import list_runs

    database = parsing.results_to_read(results)
    typed = {"task": task, "algo": algo, "representation": representation}
    if failed and status not in (None, "failed"):
        raise RequestError(f"--failed and --status {status} exclude each other; type one of them.")

    filters = parsing.run_filters(database, seed, "failed" if failed else status, **typed)
    what: Literal["run", "import"] = "import" if imports else "run"
    lines, problems = list_runs(database, filters, returns, what)
    rows = [_cells(line, what) for line in lines]
    if all(line.evaluation_return == line.evaluation_return_at_end for line in lines):
        for row in rows:
            del row[_AT_END]

    if rows:
        header = [name for name in rows[0] if any(row[name] not in (None, "") for row in rows)]
        values = ([row[name] for name in header] for row in rows)
        cells = [[whole(v) if isinstance(v, float) else v for v in row] for row in values]
        output.table(counted(len(rows), what), header, cells, _SPARE, below=("error",))
    else:
        output.say(f"No such {what}s in {results}." if filters else f"No {what}s in {results}.")

    output.document({f"{what}s": [asdict(line) for line in lines], "problems": problems})
    output.warn_of_damage(problems, repair_hint(results))


_AT_END = "at the end of training"


def _cells(line: "RunLine", what: Literal["run", "import"]) -> dict[str, str | float | None]:
    """Returns the cells of a row of the table by their columns; returns are numbers."""
    training_return = None if line.returns == "evaluation" else line.last_return
    return {
        what: line.run,
        "status": line.status,
        "points" if what == "import" else "episodes": f"{line.episodes:,}",
        "steps": progress_text(line.steps_done, line.steps),
        "wall time": None if line.wall_time is None else duration(line.wall_time),
        "created": line.created[:16].replace("T", " "),
        "returns": line.returns,
        "variant": line.variant,
        "error": line.error,
        "training return": training_return,
        "evaluation return": line.evaluation_return,
        _AT_END: line.evaluation_return_at_end,
    }


def tail(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    representation: str | None = options.ONE_REPRESENTATION,
    status: names.Status | None = options.ONE_STATUS,
    seed: str | None = options.SOME_SEEDS,
    last: int | None = options.whole_number(
        None,
        unit="EPISODES",
        help="How many training episodes of each run to print of those already committed, the "
        "last ones (default: all).",
    ),
    once: bool = Option(False, "--once", help="Print the committed rows and end."),
    results: Path = options.READ_RESULTS,
    json: bool = Option(False, "--json", help="Print each row as a line of JSON to stdout."),
) -> None:
    """Print episodes and evaluations as runs commit them.

    Ctrl-C ends it.
    """
    from jbench.store.follow import POLL_SECONDS, Follower

    database = parsing.results_to_read(results)
    typed = {"task": task, "algo": algo, "representation": representation}
    filters = parsing.run_filters(database, seed, status, **typed)
    follower = Follower(database, filters)
    problems = 0
    lines = _json_lines if json else _text_lines
    is_empty = True
    try:
        while True:
            for change in follower.changes():
                if isinstance(change, str):
                    output.warn(change)
                    problems += 1
                    continue

                is_empty = False
                rows = change.rows if last is None else _last(change.rows, last)
                output.raw("".join(f"{line}\n" for line in lines(change._replace(rows=rows))))

            if once:
                break
            last = None
            time.sleep(POLL_SECONDS)
    except KeyboardInterrupt:
        return

    if problems:
        count = f"{counted(problems, 'run')} {are(problems)}"
        raise WorkError(f"{count} left out; see above.")
    if is_empty:
        output.say(f"No such runs in {results}.")


def _last(rows: list[tuple[str, "Row"]], episodes: int) -> list[tuple[str, "Row"]]:
    """Returns the rows from the last episodes on."""
    starts = [i for i, (table, _) in enumerate(rows) if table == "episodes"]
    if episodes == 0:
        return []
    return rows[starts[-episodes] :] if len(starts) > episodes else rows


def _json_lines(change: "Change") -> Iterator[str]:
    """Yields the rows; before them the run if it is new, after them if its status has changed."""
    from jbench.store.run_line import make_line

    state = [("runs", asdict(make_line(change.record)))]
    rows = [*state, *change.rows] if change.is_new else change.rows
    ended = state if change.status_changed and not change.is_new else []
    for table, row in (*rows, *ended):
        yield json_format.dumps({"table": table, **row}, allow_nan=False)


def _text_lines(change: "Change") -> Iterator[str]:
    """Yields a line for each episode, evaluation and logged step, and one for the run's end."""
    from jbench.store.follow import grouped

    run = change.record
    for table, rows in grouped(change.rows):
        row = rows[0]
        steps = f"{rows[0]['control_steps']:,} control steps"
        if table == "metrics":
            values = ", ".join(
                f"{row['name']} {_mean([row['value']], '{:.4g}'.format)}" for row in rows
            )
            yield f"{run.id}: {steps}, {values}"
            continue

        mean = _mean([row["episode_return"] for row in rows], _one_decimal)
        if table == "episodes":
            after = "" if row["wall_time"] is None else f", {duration(row['wall_time'])}"
            yield f"{run.id}: episode {row['episode']}, return {mean}, {steps}{after}"
        else:
            number = row["evaluation"]
            count = counted(len(rows), "episode")
            yield f"{run.id}: evaluation {number} after {steps}, mean return {mean} of {count}"

    if change.status_changed and run.status != "unfinished":
        yield f"{run.id}: {run.status}{f': {run.error}' if run.error else ''}"


def _one_decimal(value: float) -> str:
    """Returns a return with a decimal, or a small one with two digits."""
    return f"{value:.1f}" if abs(value) >= 1 else whole(value)


def _mean(values: list[float | None], form: Form) -> str:
    """Returns the mean of numbers as text; not finite if one is missing."""
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return "not finite"
    return form(sum(known) / len(known))


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

    from jbench.commands.report import SPARE
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
    request = validated(
        Request,
        "the leaderboard",
        task=task and parsing.known_or_held("task", task, read),
        algo=algo if algo in (None, names.HEURISTIC) else parsing.known_or_held("algo", algo, read),
        returns=returns,
    )
    ranked, problems = ranked_configurations(databases, request)
    table = leaderboard_table(ranked, request.returns)
    if markdown or as_csv:
        output.raw(to_markdown(table) if markdown else to_csv(ranked))
    else:
        output.frame(table.title, table.texts(), SPARE[table.name])
        output.say(table.caption)

    output.document({"entries": records(ranked), "problems": problems})
    output.warn_of_damage(problems)
