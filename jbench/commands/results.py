"""Commands for the results database: runs, query, verify, repair, merge."""

from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal

from typer import Argument, Option

from jbench import names
from jbench.commands import checking, options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.wording import are, counted, duration, progress_text, repair_hint, with_results

_FILES = Option(0, min=0, help="Number of records checked at a time (0: one per core).")


def runs(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    representation: str | None = options.ONE_REPRESENTATION,
    status: names.Status | None = options.ONE_STATUS,
    seed: str | None = options.SOME_SEEDS,
    returns: bool = Option(
        False,
        "--returns",
        help="Show final returns (reads all episodes); quote that of the evaluation. A report also "
        "counts the episodes of jbench evaluate RUN.",
    ),
    imports: bool = Option(
        False, "--imports", help="List imported learning curves instead of runs."
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """List runs with their status, progress and wall time.

    The oldest run comes first.
    """
    from jbench.store.listing import list_runs

    database = parsing.existing_results(results)
    typed = {"task": task, "algo": algo, "representation": representation}
    filters = parsing.run_filters(database, seed, status, **typed)
    what: Literal["run", "import"] = "import" if imports else "run"
    lines, problems = list_runs(database, filters, returns, what)
    rows = [
        {
            what: line["run"],
            "status": line["status"],
            "points" if imports else "episodes": f"{line['episodes']:,}",
            "steps": progress_text(line["steps_done"], line["steps"]),
            "wall time": None if line["wall_time"] is None else duration(line["wall_time"]),
            "created": line["created"][:16].replace("T", " "),
            "returns": line["returns"],
            "variant": line["variant"],
            "error": line["error"],
            "training return": _rounded(
                None if line["returns"] == "evaluation" else line["last_return"]
            ),
            "evaluation return": _rounded(line["evaluation_return"]),
        }
        for line in lines
    ]
    output = Output(json)
    if rows:
        filled = [name for name in rows[0] if any(row[name] for row in rows)]
        cells = [[row[name] or "" for name in filled] for row in rows]
        output.table(counted(len(rows), what), filled, cells)
    else:
        output.say(f"No such {what}s in {results}." if filters else f"No {what}s in {results}.")
    output.document({f"{what}s": lines, "problems": problems})
    output.warn_of_damage(problems, repair_hint(results))


def _rounded(value: float | None) -> str | None:
    return None if value is None else f"{value:.0f}"


_SHOWN, _LONGEST = 100, 80  # rows of a query, and characters of a cell, in a table for people


def query(
    sql: str = Argument(..., help="A SELECT statement, SHOW TABLES, or DESCRIBE and a table."),
    as_csv: bool = options.CSV,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Query the results with SQL.

    SHOW TABLES lists the tables, and DESCRIBE runs the columns of the table runs.
    """
    from jbench.store.query import query_results, to_csv, to_json

    if as_csv and json:
        raise RequestError("--csv and --json exclude each other; type one of them.")
    output = Output(json)
    answer, problems = query_results(parsing.existing_results(results), sql)
    if json:
        output.raw(f"{to_json(answer)}\n")
    elif as_csv:
        output.raw(to_csv(answer))
    else:
        first = answer.head(_SHOWN).map(_cut)
        less = f", the first {_SHOWN} shown; --csv prints all" if len(answer) > _SHOWN else ""
        output.frame(counted(len(answer), "row") + less, first)
    output.warn_of_damage(problems, repair_hint(results))


def _cut(cell: Any) -> Any:
    """Cuts a long text, such as the JSON of settings, so that its row stays one of a table."""
    return cell if len(str(cell)) <= _LONGEST else f"{str(cell)[: _LONGEST - 1]}…"


def verify(
    threads: int = _FILES,
    reevaluate: bool = Option(
        False,
        "--reevaluate",
        help="Also repeat each run's last evaluation with its kept policy.",
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Check every manifest, row count and checksum.

    Files that no manifest lists are reported as well.
    """
    if reevaluate:
        checking.limit_threads()
    from jbench.store.verify import verify as check

    output, database = Output(json), parsing.existing_results(results)
    progress = partial(output.progress, "verify", unit="folders")
    checked = check(database, parsing.all_cores(threads), progress)
    record = None
    for finding in checked.findings:
        if (finding.kind, finding.id) != record:
            record = finding.kind, finding.id
            output.say(f"{finding.kind} {finding.id}")
        warning = "Warning: " if finding.sort == "warning" else ""
        output.say(f"  {warning}{finding}")
    output.say(
        f"Checked {counted(checked.records, 'record')}, {counted(checked.files, 'file')}, "
        f"{checked.bytes / 1e6:,.1f} MB: "
        + (_counted(f.sort for f in checked.findings) or "all of them intact")
        + "."
    )
    repeated = checking.reevaluate_all(database, output) if reevaluate else []
    output.document(
        {
            "records": checked.records,
            "files": checked.files,
            "bytes": checked.bytes,
            "findings": [{**f._asdict(), "path": str(f.path)} for f in checked.findings],
            **({"reevaluations": [part._asdict() for part in repeated]} if reevaluate else {}),
        }
    )
    if any(fault.sort != "foreign" for fault in checked.faults):
        raise WorkError(
            f"Some results are damaged or left over; {with_results('jbench repair', results)} sets "
            "them aside. Intact results can still be used."
        )
    if checked.faults:
        raise WorkError("Some results can't be checked; see above. The others can still be used.")
    compared = [part for part in repeated if part.control_steps is not None]
    if different := sum(part.verdict == "different" for part in compared):
        raise WorkError(
            f"{different} of {len(compared)} repeated runs have other returns than recorded; "
            "see above."
        )
    if reevaluate and not compared:
        raise WorkError("No run could be compared with its last evaluation.")


def repair(
    dry_run: bool = Option(
        False, "--dry-run", help="Show what would be set aside, and change nothing."
    ),
    threads: int = _FILES,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Move damaged records and leftover files aside.

    They are moved to RESULTS/set-aside; nothing is deleted.
    """
    from jbench.store.repair import repair as set_aside
    from jbench.store.verify import verify as check

    parsing.results_to_write(results)
    output, database = Output(json), parsing.existing_results(results)
    progress = partial(output.progress, "repair", unit="folders")
    checked = check(database, parsing.all_cores(threads), progress)
    done = set_aside(database, checked.findings, dry_run)
    for moved, to in done.moved:
        output.say(f"{moved} -> {to}")
    for sentence in done.left:
        output.warn(sentence)
    verb, count = "Would set" if dry_run else "Set", counted(len(done.moved), "file")
    output.say(f"{verb} {count} aside." if done.moved else "Nothing to set aside.")
    if done.commands and not dry_run:
        output.say("\n    ".join(["To make damaged records again, repeat:", *done.commands]))
    output.document(
        {
            "dry_run": dry_run,
            "moved": [{"from": str(moved), "to": str(to)} for moved, to in done.moved],
            "left": done.left,
            "commands": done.commands,
        }
    )
    if done.left:
        left = len(done.left)
        raise WorkError(f"{counted(left, 'problem')} {are(left)} left as before; see above.")


def merge(
    others: list[Path] = Argument(
        ..., parser=options.path, metavar="DIR", help="Results directories of other machines."
    ),
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Merge results of several machines.

    Intact records are copied; records that differ are refused.
    """
    from jbench.store.merge import merge as join

    output, database = Output(json), parsing.results_to_write(results)
    sources = [parsing.results_at(other) for other in others]
    merged = join(database, sources, partial(output.progress, "merge", unit="records"))
    refused = [record for record in merged if record.outcome == "refused"]
    for record in refused:
        output.warn(f"{record.record}: {record.reason}")
    outcomes = _counted(record.outcome for record in merged) or "no records"
    output.say(f"Merged into {results}: {outcomes}.")
    output.document({"records": [record._asdict() for record in merged]})
    if refused:
        raise WorkError(
            f"{counted(len(refused), 'record')} {are(len(refused))} refused, see above; the others "
            "are merged."
        )


def _counted(words: Iterator[str]) -> str:
    """Returns the count of each word, such as `3 damaged, 1 leftover`."""
    return ", ".join(f"{count:,} {word}" for word, count in Counter(words).items())
