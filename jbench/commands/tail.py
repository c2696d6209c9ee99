"""The command tail: rows of runs as they are committed."""

import json as json_format
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.errors import WorkError
from jbench.numbers import Form, one_decimal
from jbench.wording import are, counted, duration

if TYPE_CHECKING:
    from jbench.store.follow import Change
    from jbench.store.rows import Row


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
    lines_of = _text_lines
    if json:
        lines_of = _json_lines

    is_empty = True
    is_told = False  # that there are no runs yet
    try:
        while True:
            for change in follower.changes():
                if isinstance(change, str):
                    output.warn(change)
                    problems += 1
                    continue

                is_empty = False
                if last is not None:
                    change = change._replace(rows=_last(change.rows, last))
                output.raw("".join(f"{line}\n" for line in lines_of(change)))

            if once:
                break
            if is_empty and not is_told:
                output.say(f"No such runs in {results} yet; they are printed here as they come.")
                is_told = True

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
    if len(starts) <= episodes:
        return rows
    return rows[starts[-episodes] :]


def _json_lines(change: "Change") -> Iterator[str]:
    """Yields the rows; before them the run if it is new, after them if its status has changed."""
    from jbench.store.run_line import make_line

    run = ("runs", asdict(make_line(change.record)))
    rows = [*change.rows]
    if change.is_new:
        rows.insert(0, run)
    elif change.status_changed:
        rows.append(run)

    for table, row in rows:
        yield json_format.dumps({"table": table, **row}, allow_nan=False)


def _text_lines(change: "Change") -> Iterator[str]:
    """Yields a line for each episode, evaluation and logged step, and one for the run's end."""
    from jbench.store.follow import grouped

    run = change.record
    for table, rows in grouped(change.rows):
        row = rows[0]
        steps = f"{rows[0]['control_steps']:,} control steps"
        if table == "metrics":
            values = [f"{row['name']} {_mean([row['value']], _four_digits)}" for row in rows]
            yield f"{run.id}: {steps}, {', '.join(values)}"
            continue

        mean = _mean([row["episode_return"] for row in rows], one_decimal)
        if table == "episodes":
            line = f"{run.id}: episode {row['episode']}, return {mean}, {steps}"
            if row["wall_time"] is not None:
                line += f", {duration(row['wall_time'])}"
            yield line
        else:
            number = row["evaluation"]
            count = counted(len(rows), "episode")
            yield f"{run.id}: evaluation {number} after {steps}, mean return {mean} of {count}"

    if change.status_changed and run.status != "unfinished":
        line = f"{run.id}: {run.status}"
        if run.error:
            line += f": {run.error}"
        yield line


def _four_digits(value: float) -> str:
    """Returns a logged value as text."""
    return f"{value:.4g}"


def _mean(values: list[float | None], form: Form) -> str:
    """Returns the mean of numbers as text; not finite if one is missing."""
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return "not finite"
    return form(sum(known) / len(known))
