"""What is finished of a sweep, and how long the rest takes: a table and entries of a document."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

from jbench.commands import output
from jbench.store import Results
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.cell_status import CellStatus, cell_statuses, seconds_left
from jbench.sweeps.preparation import missing_encoders
from jbench.training.continuation import new_beginnings
from jbench.training.status import RunState, run_status
from jbench.wording import counted, duration

_SHOWN_IF_VARIED = (
    "part",
    "encoders",
    "settings",
    "changed",
    "precision",
    "environments",
    "time_limit",
    "steps",
)
"""Fields of an entry that are columns of the table if they differ between entries."""


@dataclass(frozen=True)
class ConfigurationSettings:
    """The settings of a configuration of a sweep.

    Attributes:
        settings: source of the hyperparameters.
        encoder: id of the encoder of the first run, if there is one.
        steps: planned control steps of each run.
        environments: number in parallel, if it is not the default of the algorithm.
        runs: ids.
        encoders: whether agents share `one` encoder or `each` has its own; None without encoders.
        part: name of the part of the matrix; None for runs of `jbench train`.
        changed: hyperparameters that the matrix changes, in words; None if there are none.
    """

    task: str
    algo: str
    representation: str
    settings: str
    encoder: str | None
    precision: str
    time_limit: str
    steps: int
    environments: int | None
    runs: list[str]
    encoders: str | None
    part: str | None
    changed: str | None


def show_cells(
    matrix: str | None,
    cells: Sequence[Cell],
    results: Results,
    jobs: int,
    device: str,
    times: bool,
    final_episodes: int | None,
) -> dict[str, Any]:
    """Prints how many seeds of each configuration are finished, and returns it for JSON.

    Args:
        matrix: its name; None for the runs of `jbench train`.
        cells: the configurations.
        results: that have the finished runs.
        jobs: number of processes at a time.
        device: that of the batched engine.
        times: whether to print the time left, too. Algorithms without a similar finished run are
            then measured, which takes seconds.
        final_episodes: those of last evaluations, if the user typed them.
    """
    statuses = cell_statuses(cells, results, jobs, device, times, final_episodes)
    entries = [_entry(status) for status in statuses]
    left = seconds_left(statuses, jobs)

    title = counted(len(all_runs(cells)), "run")
    if matrix is not None:
        title = f"{matrix}: {title}"

    header = _header(entries)
    rows = [[_text(entry[name]) for name in header] for entry in entries]
    if times:
        header += ["time left", "estimated from"]
        for row, status in zip(rows, statuses, strict=True):
            row += [_time_left(status), status.estimate]

        for sentence in _notes(cells, results):
            output.say(sentence)

    output.table(title, header, rows, spare=("estimated from",))
    if times and any(status.steps_left for status in statuses):
        first = missing_encoders(cells, results)
        output.say(_sentence_on_time_left(statuses, left, jobs, excludes_first=bool(first)))

    return {"configurations": entries, "seconds_left": left}


def _notes(cells: Sequence[Cell], results: Results) -> list[str]:
    """Returns what to know of cells before their runs are trained, each sentence once."""
    notes = dict.fromkeys(itertools.chain.from_iterable(cell.notes for cell in cells))
    missing = [run for run in all_runs(cells) if run_status(run, results).state == "missing"]
    return [*notes, *new_beginnings(missing, results)]


def _entry(status: CellStatus) -> dict[str, Any]:
    """Returns an entry of the document: the settings of a cell, then the numbers of its status."""
    numbers = status._asdict()
    del numbers["cell"]
    del numbers["failing_again"]
    return {**asdict(_settings(status.cell)), **numbers}


def _settings(cell: Cell) -> ConfigurationSettings:
    """Returns the settings of a cell."""
    first = cell.runs[0]
    encoders = None
    if cell.encoders:
        encoders = "each"
        if first.encoder_draws is None:
            encoders = "one"

    part = None
    changed = ""
    if cell.arms:
        part = cell.arms[0].part.name
        changes = cell.arms[0].part.hyperparameters.get(cell.algo, {})
        changed = ", ".join(f"{name}={value}" for name, value in changes.items())

    return ConfigurationSettings(
        task=cell.task,
        algo=cell.algo,
        representation=cell.representation,
        settings=cell.base,
        encoder=first.encoder,
        precision=first.precision,
        time_limit=first.time_limit,
        steps=first.steps,
        environments=first.parallel,
        runs=[run.id for run in cell.runs],
        encoders=encoders,
        part=part,
        changed=changed or None,
    )


def _header(entries: Sequence[dict[str, Any]]) -> list[str]:
    """Returns the fields that the table shows: what differs, and the states that seeds are in."""
    varied = [name for name in _SHOWN_IF_VARIED if len({entry[name] for entry in entries}) > 1]
    states = [state for state in get_args(RunState) if any(entry[state] for entry in entries)]
    return ["task", "algo", "representation", *varied, *states]


def _text(value: str | int | None) -> str:
    """Returns a field as the table shows it."""
    if isinstance(value, int):
        return f"{value:,}"
    return value or ""


def _time_left(status: CellStatus) -> str:
    """Returns the time left of a cell as the table shows it; "" if no step is left."""
    if not status.steps_left:
        return ""
    return _time(status.seconds_left)


def _time(seconds: float | None) -> str:
    """Returns a time left as text."""
    return "unknown" if seconds is None else duration(seconds)


def _sentence_on_time_left(
    statuses: Sequence[CellStatus], seconds: float | None, jobs: int, *, excludes_first: bool
) -> str:
    """Returns the sentence on the time that all configurations take together.

    `excludes_first` says whether datasets and encoders are made first, whose time is not known.
    """
    processes = counted(jobs, "process", "processes")
    included = ""
    if seconds is None:
        included = " until each configuration has a finished run"
    elif any(status.failed and status.steps_left for status in statuses):
        included = ", the failed runs included"

    if excludes_first and seconds is not None:
        included += ", without the datasets and encoders below"

    return f"Time left with {processes} at a time: {_time(seconds)}{included}."
