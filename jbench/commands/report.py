"""The report command."""

import contextlib
import shlex
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.commands.stopped import stopped_report
from jbench.commands.verdict_tables import print_verdicts
from jbench.commands.watching import changes, open_page
from jbench.errors import NothingYetError, RequestError, WorkError
from jbench.report.request import Request, bounds_typed, is_directory, names_typed
from jbench.settings.base import validated
from jbench.wording import repair_hint

if TYPE_CHECKING:
    from jbench.report.frames import Frames
    from jbench.report.report import WrittenReport
    from jbench.report.table import Table
    from jbench.store import Results

_FEW_TESTS = 40
"""Tests of claims that a terminal shows one by one: about a page of it."""


@options.with_settings(
    Request,
    "since",
    "returns",
    "order",
    "window",
    "claims",
    "each_seed",
    "columns",
    "reference",
    "baseline",
    "published",
    "margin",
)
def report(
    task: str | None = options.ONE_TASK,
    algo: list[str] = options.SOME_ALGORITHMS,
    compare: tuple[str, str] | None = Option(
        None,
        metavar="A B",
        help="Compare two results directories, or two settings: engine=sb3 engine=batched.",
    ),
    curves: Path | None = Option(
        None,
        parser=parsing.path,
        metavar="FILE",
        help="Report the learning curves of this file or folder instead of results, of any "
        "environment: CSV with columns such as method, task, seed, steps, return, JSON of "
        "HumanoidBench, or files of stable-baselines3.",
    ),
    format_: list[str] = Option(
        ["png", "svg"],
        "--format",
        metavar="FORMAT",
        help=f"Format of the figures: {', '.join(names.FIGURE_FORMATS)}; repeatable.",
        autocompletion=lambda: names.FIGURE_FORMATS,
    ),
    names_: list[str] = Option(
        [],
        "--names",
        metavar="OLD=NEW",
        help="Show a representation, its kind, or a method of a file by another name: "
        "six-rows=ours; repeatable.",
    ),
    normalize: list[str] = Option(
        [],
        metavar="TASK=LOW,HIGH",
        help="Returns of a task that are 0 and 1 where returns of several tasks are normalized "
        "(default: the lowest and highest that are possible, or else recorded); repeatable.",
    ),
    table_columns: str | None = Option(
        None,
        metavar="NAMES",
        help="Columns of tables/final_returns.tex, with commas, or all (default: those that fit a "
        "column of a paper).",
    ),
    study: list[str] = Option(
        [],
        metavar="FILE.toml",
        help="Also decide the comparisons of this matrix file, as jbench sweep FILE.toml "
        "--until-decided does; repeatable.",
    ),
    watch: bool = Option(
        False,
        "--watch",
        help="Write the page again whenever the results change, and the whole report after Ctrl-C.",
    ),
    out: Path | None = Option(
        None,
        parser=parsing.path,
        help="Output directory (default: RESULTS/report; with --compare, RESULTS/comparison; with "
        "--curves, FILE-report).",
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
    **chosen: Any,
) -> None:
    """Write a report of all runs across seeds.

    It has learning curves, statistics and tables, as files and as an HTML page.
    """
    algo = [name for text in algo for name in parsing.comma_separated(text)]
    sides = [Path(side) for side in compare or () if is_directory(side)]
    database, read = _databases(results, sides, curves)
    _check_studies(study)
    if watch and json:
        raise RequestError("--watch and --json exclude each other; type one of them.")
    if watch and curves is not None:
        raise RequestError("--watch and --curves exclude each other; type one of them.")
    if results != Path(names.RESULTS) and curves is not None:
        raise RequestError("--results and --curves exclude each other; type one of them.")
    if curves is None:  # a file may have tasks and algorithms that only it knows
        task = task and parsing.known_or_held("task", task, read)
        algo = [parsing.known_or_held("algo", name, read) for name in algo]

    columns_of_table = None
    if table_columns is not None:
        columns_of_table = tuple(parsing.comma_separated(table_columns))

    typed = [word for word in sys.argv[1:] if word not in ("--json", "--watch")]
    request = validated(
        Request,
        "the report",
        task=task,
        algo=tuple(dict.fromkeys(algo)),
        formats=tuple(dict.fromkeys(format_)),
        compare=compare,
        curves=curves,
        study=tuple(dict.fromkeys(study)),
        normalize=bounds_typed(normalize),
        names=names_typed(names_),
        table_columns=columns_of_table,
        watched=watch,
        command=shlex.join(["jbench", *typed]),
        **chosen,
    )

    out = out or _usual_directory(results, database, request)
    if watch:
        _watch(database, [database.path, *sides], out, request)
    else:
        _report(database, out, request)


def _databases(
    results: Path, sides: Sequence[Path], curves: Path | None
) -> tuple["Results", list["Results"]]:
    """Returns the results of --results, and those whose tasks and algorithms a user may type.

    If two directories are compared, or a file is reported, --results is not read.
    """
    from jbench.store import Results

    if len(sides) == 2 or curves is not None:
        return Results(results), [parsing.results_to_read(side) for side in sides]

    database = parsing.results_to_read(results)
    return database, [database]


def _usual_directory(results: Path, database: "Results", request: Request) -> Path:
    """Returns where a report is written without --out."""
    if request.curves is not None:
        return Path(f"{request.curves.resolve().stem}-report")

    name = "comparison" if request.compare else "report"
    if names.is_reference(results):  # the shipped results are read-only
        return Path(f"reference-{name}")

    return database.inside(name)


def _check_studies(study: Sequence[str]) -> None:
    """Raises a RequestError if a matrix file of --study can't be used."""
    from jbench.studies.comparisons import file_comparisons

    for name in study:
        file_comparisons(name)


def _watch(database: "Results", read: Sequence[Path], out: Path, request: Request) -> None:
    """Writes the page whenever what is read changes, until Ctrl-C, and then the whole report."""
    output.say("Watching; Ctrl-C ends it.")
    opened = False
    with contextlib.suppress(KeyboardInterrupt):
        for _ in changes(read):
            _report_if_possible(database, out, request)
            opened = opened or open_page(out / names.PAGE)

    output.say("No longer watching; writing the last report with all its files.")
    _report_if_possible(database, out, request.model_copy(update={"watched": False}))


def _report_if_possible(database: "Results", out: Path, request: Request) -> None:
    """Writes a report; prints why not if there are no runs yet, or some can't be read."""
    try:
        _report(database, out, request)
    except NothingYetError as error:
        output.say(f"Nothing to report yet: {error}")
    except WorkError as error:
        output.warn(str(error))


def _report(database: "Results", out: Path, request: Request) -> None:
    """Writes a report and prints what it says first: verdicts, tables and notes."""
    output.if_stopped(partial(stopped_report, out))
    from jbench.report.report import write_report  # it loads for seconds

    source: Results | None = database
    if request.curves is not None:
        source = None

    written = write_report(source, out, request)
    frames = written.frames
    _print_tables(frames)
    for note in written.notes:
        output.say(f"Note: {note}")

    output.say(frames.headline)
    page = out / names.PAGE
    output.say(f"Wrote {len(written.files)} files to {page.parent}; open {page} in a browser.")
    if output.is_json:
        output.document(_document(written))

    output.warn_of_damage(frames.problems, repair_hint(database.name))


def _print_tables(frames: "Frames") -> None:
    """Prints the tables that answer what was asked."""
    from jbench.report.tables import tables
    from jbench.report.verdict_matrices import verdict_matrices

    request = frames.request
    asked = {"comparisons"}
    if not request.compare:
        asked.update(["final_returns", "verdicts"])
    if request.study:
        asked.add("sequential_test")

    for table in tables(frames):
        if table.name == "claims":
            _print_claims(frames, table)
        elif table.name == "verdicts" and table.name in asked:
            for matrix in verdict_matrices(frames):
                print_verdicts(table.title, matrix)
        elif table.name in asked:
            output.frame(table.title, table.texts(), table.spare)


def _print_claims(frames: "Frames", tests: "Table") -> None:
    """Prints how many comparisons support each claim, and each comparison if they are few."""
    from jbench.report.comparison_tables import claim_counts_table

    counts = claim_counts_table(frames)
    output.frame(counts.title, counts.texts(), counts.spare)
    if len(tests.frame) <= _FEW_TESTS:
        output.frame(tests.title, tests.texts(), tests.spare)
    else:
        output.say(
            f"All {len(tests.frame)} comparisons, with effects and intervals, are in the page, in "
            "tables/claims.csv and in the document of --json."
        )


def _document(written: "WrittenReport") -> dict[str, Any]:
    """Returns what --json prints."""
    from jbench.store.query import records

    frames = written.frames
    shown = ["configurations", "verdicts", "comparisons"]
    if frames.request.claims:
        shown.append("claims")

    entries = {name: records(getattr(frames, name)) for name in shown}
    about = {"files": written.files, "notes": written.notes, "problems": frames.problems}
    return {"headline": frames.headline, **entries, **about}
