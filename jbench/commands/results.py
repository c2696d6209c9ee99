"""Commands for the results database: query, repair, merge, import."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument, Option

from jbench.commands import options, output, parsing
from jbench.errors import RequestError, WorkError
from jbench.importing.request import ImportRequest
from jbench.names import REFERENCE
from jbench.settings.base import validated
from jbench.wording import are, counted, repair_hint, with_results

if TYPE_CHECKING:
    import pandas as pd

_SHOWN = 100  # rows of a query in a table for people
_LONGEST = 80  # characters of a cell of it with JSON
_LONGEST_SENTENCE = 400  # of one with another text, such as an error


def query(
    sql: str = Argument(..., help="A SELECT statement, SHOW TABLES, or DESCRIBE and a table."),
    as_csv: bool = options.CSV,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Query the results with SQL.

    SHOW TABLES lists the tables, and DESCRIBE runs the columns of the table runs.
    """
    from jbench.store import Results
    from jbench.store.query import named_tables, query_results, records, to_csv

    if as_csv and json:
        raise RequestError("--csv and --json exclude each other; type one of them.")

    # The paper's curves are in jbench, so results need not exist.
    database = Results(results)
    if named_tables(sql) != {"published"}:
        database = parsing.results_to_read(results)

    answer, problems, notes = query_results(database, sql)
    if json:
        output.raw(f"{output.json_text(records(answer))}\n")
    elif as_csv:
        output.raw(to_csv(answer))
    else:
        _show_answer(answer)

    for note in notes:
        output.warn(note)
    output.warn_of_damage(problems, repair_hint(results))


def _show_answer(answer: "pd.DataFrame") -> None:
    """Prints a table of the first rows of an answer, and says what of it is left out."""
    first = answer.head(_SHOWN).map(_as_list)
    shown = first.map(_cut)
    title = counted(len(answer), "row")
    if len(answer) > _SHOWN:
        title += f", the first {_SHOWN} shown; --csv prints all"
    elif not shown.equals(first):
        title += "; --csv prints long texts whole"

    output.frame(title, shown)


def _as_list(cell: Any) -> Any:
    """Returns a cell; of an array, whose own text leaves out the middle, that of its list."""
    if getattr(cell, "ndim", 0):
        return str(cell.tolist())
    return cell


def _cut(cell: Any) -> Any:
    """Returns a cell; of a long text, such as the JSON of settings, its beginning.

    Its row then stays one of the table.
    """
    text = str(cell)
    longest = _LONGEST_SENTENCE
    if text.startswith(("{", "[")):
        longest = _LONGEST

    if len(text) <= longest:
        return cell
    return f"{text[: longest - 1]}…"


def repair(
    dry_run: bool = Option(False, "--dry-run", help="Show what would be set aside; move nothing."),
    threads: int = options.FILES,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Move damaged records and leftover files aside.

    They are moved to RESULTS/set-aside; nothing is deleted.
    """
    from jbench.store.repair import repair as set_aside
    from jbench.store.verify import verify as check

    parsing.results_to_write(results)
    database = parsing.results_to_read(results)
    checked = check(database, threads, partial(output.progress, "repair", unit="folders"))
    output.if_stopped("What was moved stays there; the same command moves the rest.")
    done = set_aside(database, checked.findings, dry_run)
    for source, target in done.moved:
        output.say(f"{source} -> {target}")

    for sentence in done.left:
        output.warn(sentence)

    count = counted(len(done.moved), "file")
    if not done.moved:
        output.say("Nothing to set aside.")
    elif dry_run:
        output.say(f"Would set {count} aside.")
    else:
        output.say(f"Set {count} aside.")

    if done.commands and not dry_run:
        output.say("\n    ".join(["To make damaged records again, repeat:", *done.commands]))

    moves = [{"from": source, "to": target} for source, target in done.moved]
    output.document({"dry_run": dry_run} | done._asdict() | {"moved": moves})
    if done.left:
        count = counted(len(done.left), "problem")
        raise WorkError(f"{count} {are(len(done.left))} left as before; see above.")


def merge(
    others: list[Path] = Argument(
        ...,
        parser=parsing.path,
        metavar="DIR",
        help=f"Results directories of other machines ({REFERENCE}: the results shipped with "
        "jbench).",
    ),
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Merge results of several machines.

    Intact records are copied. A finished record replaces an unfinished one, which is moved to
    RESULTS/set-aside. Damaged records are refused, and those that differ from the ones that are
    there.
    """
    from jbench.store.merge import merge as join

    database = parsing.results_to_write(results)
    sources = [parsing.results_to_read(other) for other in others]
    output.if_stopped("Records that were copied are kept; the same command copies the others.")
    merged = join(database, sources, partial(output.progress, "merge", unit="records"))
    refused = [record for record in merged if record.outcome == "refused"]
    for record in refused:
        output.warn(f"{record.record}: {record.reason}")

    outcomes = output.tally(record.outcome for record in merged) or "no records"
    output.say(f"Merged into {results}: {outcomes}.")
    output.document({"records": [record._asdict() for record in merged]})
    if refused:
        count = f"{counted(len(refused), 'record')} {are(len(refused))}"
        kept = "; the others are merged"
        if len(refused) == len(merged):
            kept = ""

        raise WorkError(f"{count} refused, see above{kept}.")


@options.with_settings(
    ImportRequest,
    "format",
    "algo",
    "seed_from",
    "representation",
    "steps_column",
    "return_column",
    "seed_column",
    "tag",
    "returns",
)
def import_(
    files: list[Path] = Argument(..., parser=parsing.path, metavar="FILE", help="Learning curves."),
    task: str = options.REQUIRED_TASK,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
    **chosen: Any,
) -> None:
    """Import learning curves made by other programs.

    The report draws them beside runs; they have no verdict.
    """
    from jbench.importing.importer import import_curves
    from jbench.tasks.find import find_task

    database = parsing.results_to_write(results)
    request = validated(ImportRequest, "the import", task=find_task(task).name, **chosen)
    output.if_stopped("Curves that were imported are kept; the same command imports the others.")
    imported = import_curves(database, files, request)
    for curve in imported:
        length = counted(curve.control_steps, "control step")
        line = f"{curve.id}: {counted(curve.points, 'point')}, {length}"
        if not curve.is_new:
            line += "; imported before, nothing is changed"
        output.say(line)

    new = sum(curve.is_new for curve in imported)
    output.say(
        f"Imported {new:,} of {len(imported):,} curves into {results}; they are not verified. "
        f"Next: {with_results('jbench report', results)}"
    )
    output.document({"imports": [curve._asdict() for curve in imported]})
