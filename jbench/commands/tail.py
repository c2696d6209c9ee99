"""The tail command."""

import json as json_format
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import WorkError
from jbench.wording import are, counted, duration

if TYPE_CHECKING:
    from jbench.store.follow import Change, Row


def tail(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    representation: str | None = options.ONE_REPRESENTATION,
    status: names.Status | None = options.ONE_STATUS,
    seed: str | None = options.SOME_SEEDS,
    last: int | None = Option(
        None,
        min=0,
        help="Of the rows that are already committed, print those of the last N training episodes "
        "of each run (default: all).",
    ),
    once: bool = Option(False, "--once", help="Print the committed rows and end."),
    results: Path = options.READ_RESULTS,
    json: bool = Option(False, "--json", help="Print each row as a line of JSON to stdout."),
) -> None:
    """Print episodes and evaluations as runs commit them.

    Ctrl-C ends it.
    """
    from jbench.store.follow import LOOK_EVERY, Follower

    database = parsing.existing_results(results)
    typed = {"task": task, "algo": algo, "representation": representation}
    filters = parsing.run_filters(database, seed, status, **typed)
    output, follower, problems = Output(json), Follower(database, filters), 0
    lines, is_empty = _json_lines if json else _text_lines, True
    try:
        while True:
            for change in follower.look():
                if isinstance(change, str):
                    output.warn(change)
                    problems += 1
                    continue
                is_empty = False
                if last is not None:
                    change = change._replace(rows=_last(change.rows, last))
                output.raw("".join(f"{line}\n" for line in lines(change)))
            if once:
                if is_empty and not problems:
                    output.say(f"No such runs in {results}.")
                break
            last = None
            time.sleep(LOOK_EVERY)
    except KeyboardInterrupt:
        return
    if problems:
        raise WorkError(
            f"{counted(problems, 'run')} {are(problems)} damaged and left out; see above."
        )


def _last(rows: list["Row"], episodes: int) -> list["Row"]:
    """Returns the rows of the last training episodes and those after them."""
    first = [i for i, (table, _) in enumerate(rows) if table == "episodes"]
    if not episodes:
        return []
    return rows if len(first) <= episodes else rows[first[-episodes] :]


def _json_lines(change: "Change") -> Iterator[str]:
    """Yields the rows; before them the run if it is new, after them if its status has changed."""
    from jbench.store.listing import make_line

    state = [("runs", make_line(change.record))]
    rows = [*state, *change.rows] if change.is_new else change.rows
    ended = state if change.status_changed and not change.is_new else []
    for table, row in (*rows, *ended):
        yield json_format.dumps({"table": table, **row}, allow_nan=False)


def _text_lines(change: "Change") -> Iterator[str]:
    """Yields a line for each episode, evaluation and logged step, and one for the run's end."""
    from jbench.store.follow import grouped

    run = change.record
    for table, rows in grouped(change.rows):
        if table == "episodes":
            yield f"{run.id}: {_episode(rows[0])}"
        elif table == "metrics":
            values = ", ".join(f"{row['name']} {_value(row['value'])}" for row in rows)
            yield f"{run.id}: {rows[0]['control_steps']:,} control steps, {values}"
        else:
            yield (
                f"{run.id}: evaluation {rows[0]['evaluation']} after {rows[0]['control_steps']:,} "
                f"control steps, mean return {_mean([row['episode_return'] for row in rows])} of "
                + counted(len(rows), "episode")
            )
    if change.status_changed and run.status != "unfinished":
        yield f"{run.id}: {run.status}{f': {run.error}' if run.error else ''}"


def _episode(row: Mapping[str, Any]) -> str:
    after = "" if row["wall_time"] is None else f", {duration(row['wall_time'])}"
    return (
        f"episode {row['episode']}, return {_mean([row['episode_return']])}, "
        f"{row['control_steps']:,} control steps{after}"
    )


def _value(value: float | None) -> str:
    return "not finite" if value is None else f"{value:.4g}"


def _mean(returns: list[float | None]) -> str:
    """Formats the mean of returns; a return that is not finite is None."""
    known = [value for value in returns if value is not None]
    return f"{sum(known) / len(known):.1f}" if len(known) == len(returns) else "not finite"
