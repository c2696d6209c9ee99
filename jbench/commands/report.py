"""The report command."""

import contextlib
import dataclasses
import shlex
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import NothingYetError, RequestError, WorkError
from jbench.opengl import has_display
from jbench.wording import repair_hint

if TYPE_CHECKING:
    from jbench.report.report import Report
    from jbench.report.request import Request
    from jbench.store import Results


def _two_sides(sides: tuple[str, str] | None) -> tuple[str, str] | None:
    """Refuses an option as the second side, which then lacks its value."""
    if sides is not None and sides[1].startswith("--"):
        raise RequestError(
            f"--compare {sides[0]}: type two results directories, or two settings such as "
            "engine=sb3 engine=batched."
        )
    return sides


def report(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    since: str | None = Option(
        None, help="Only runs that began at this date or later, in UTC, such as 2026-11-21."
    ),
    claims: bool = Option(False, "--claims", help="Add verdicts on the paper's claims."),
    compare: tuple[str, str] | None = Option(
        None,
        metavar="A B",
        callback=_two_sides,
        help="Compare two results directories, or two settings: engine=sb3 engine=batched.",
    ),
    curves: Path | None = Option(
        None,
        parser=options.path,
        metavar="FILE",
        help="Report the learning curves of this file instead of results: CSV with the columns "
        "method, task, seed, steps, return, or JSON of HumanoidBench, of any environment.",
    ),
    reference: bool = Option(False, "--reference", help="Add the runs shipped with jbench."),
    baseline: str | None = Option(
        None, help="Draw the imported curves of this algorithm dashed, as published curves are."
    ),
    returns: names.ReturnsName = Option(
        "evaluation",
        help="Returns that figures and statistics show first: evaluation (deterministic policy) or "
        "training (exploration included).",
    ),
    order: names.Order = Option(
        "quantile-first",
        help="Order of smoothing: quantile-first (as Figure 9) or smooth-first (as Figure 8).",
    ),
    window: int = Option(100, help="Number of episodes in a moving average."),
    each_seed: bool = Option(False, "--each-seed", help="Draw every seed as a thin line as well."),
    format_: list[str] = Option(
        ["png", "svg"],
        "--format",
        metavar="FORMAT",
        help=f"Format of the figures: {', '.join(names.FIGURE_FORMATS)}; repeatable.",
        autocompletion=options.complete(*names.FIGURE_FORMATS),
    ),
    columns: int | None = Option(
        None, help="Draw figures for 1 or 2 columns of a paper (default: for a screen)."
    ),
    watch: bool = Option(
        False,
        "--watch",
        help="Write the page again whenever the results change, and the whole report after Ctrl-C.",
    ),
    out: Path | None = Option(
        None,
        parser=options.path,
        help="Output directory (default: RESULTS/report; with --compare, RESULTS/comparison; with "
        "--curves, FILE-report).",
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Write a report of all runs across seeds.

    It has learning curves, statistics and tables, as files and as an HTML page.
    """
    from jbench.report.request import Request
    from jbench.store import Results

    # If two directories are compared, or a file is reported, --results is not read.
    sides = [Path(side) for side in compare or () if Path(side).is_dir()]
    unread = len(sides) == 2 or curves is not None
    database = parsing.results_at(results) if unread else parsing.existing_results(results)
    read = [Results(side) for side in sides] if unread else [database]
    output = Output(json)
    if watch and (json or curves):
        other = "--json" if json else "--curves"
        raise RequestError(f"--watch and {other} exclude each other; type one of them.")
    request = Request(
        order=order,
        window=window,
        task=task and (task if curves else parsing.known_or_held("task", task, read)),
        algo=algo and (algo if curves else parsing.known_or_held("algo", algo, read)),
        since=since,
        returns=returns,
        claims=claims,
        each_seed=each_seed,
        formats=tuple(dict.fromkeys(format_)),
        columns=columns,
        reference=reference,
        baseline=baseline,
        compare=compare,
        curves=curves,
        watched=watch,
        command=_command(),
    )
    name = "comparison" if compare else "report"
    # The shipped results are read-only.
    where = out or (
        Path(f"{curves.stem}-report")
        if curves is not None
        else Path(f"reference-{name}")
        if names.is_reference(results)
        else database.inside(name)
    )
    if watch:
        _watch(database, where, request, output)
    else:
        _report(database, where, request, output)


def _report(database: "Results", out: Path, request: "Request", output: Output) -> None:
    """Writes a report and prints its main tables and notes."""
    from jbench.report.report import write_report

    written = write_report(None if request.curves else database, out, request)
    _show(written, output)
    if output.as_json:
        output.document(_document(written))
    output.warn_of_damage(written.frames.problems, repair_hint(database.name))


def _watch(database: "Results", out: Path, request: "Request", output: Output) -> None:
    """Writes a page whenever the results change, and the whole report after Ctrl-C."""
    from jbench.commands.watching import remembered_interrupt, watch

    def write(request: "Request") -> None:
        try:
            _report(database, out, request, output)
        except NothingYetError as error:
            output.say(f"Nothing to report yet: {error}")
        except WorkError as error:
            output.warn(str(error))

    output.say("Watching; Ctrl-C ends it.")
    opened = False
    with contextlib.suppress(KeyboardInterrupt), remembered_interrupt() as interrupt:
        for _ in watch(database, request, interrupt):
            write(request)
            opened = opened or open_page(out / "index.html")
    output.say("No longer watching; writing the last report with all its files.")
    write(dataclasses.replace(request, watched=False))


def open_page(page: Path) -> bool:
    """Opens a page in a browser if the command was typed in a terminal with a display.

    Returns:
        Whether it was opened.
    """
    shows = sys.stdout.isatty() and has_display() and page.exists()
    return shows and webbrowser.open(page.resolve().as_uri())


def _show(written: "Report", output: Output) -> None:
    """Prints the headline, the tables that were asked for, notes, and the path of the page."""
    from jbench.report.tables import tables

    request = written.frames.request
    asked = {"comparisons"} if request.compare else {"final_returns", "verdicts"}
    asked |= {"comparisons"} if request.curves else set()
    asked |= {"claims"} if request.claims else set()
    for table in tables(written.frames):
        if table.name in asked:
            output.frame(table.title, table.texts())
    for note in written.notes:
        output.say(f"Note: {note}")
    output.say(written.frames.headline)
    page = next(file for file in written.files if file.name == "index.html")
    output.say(f"Wrote {len(written.files)} files to {page.parent}; open {page} in a browser.")


def _document(written: "Report") -> dict[str, Any]:
    """Returns the JSON document."""
    from jbench.store.query import records

    frames = written.frames
    names = ["configurations", "verdicts", "comparisons"]
    names += ["claims"] if frames.request.claims else []
    return {
        "headline": frames.headline,
        **{name: records(getattr(frames, name)) for name in names},
        "files": [str(file) for file in written.files],
        "notes": written.notes,
        "problems": frames.problems,
    }


def _command() -> str:
    """Returns the command line that writes this report again."""
    typed = [word for word in sys.argv[1:] if word not in ("--json", "--watch")]
    return shlex.join(["jbench", *typed])
