"""What `jbench sweep` does and shows: the matrix as a table, before and after its runs."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import (
    AbstractContextManager,
    closing,
    contextmanager,
    nullcontext,
    redirect_stdout,
)
from typing import Any

from jbench.commands.display import show_plan
from jbench.commands.live_view import sweep_view
from jbench.commands.output import Output, duration
from jbench.settings.dataset import DatasetSettings
from jbench.store import Results
from jbench.store.provenance import cores
from jbench.sweeps.executors import Executor
from jbench.sweeps.matrix import Cell, all_runs
from jbench.sweeps.prepare import Show, missing_dataset, missing_encoders, prepare
from jbench.sweeps.sweep import sweep
from jbench.training.status import CellStatus, plan, seconds_left


def sweep_with_view(
    cells: Sequence[Cell],
    results: Results,
    make: Callable[[], Executor],
    device: str,
    retry_failed: bool,
    output: Output,
) -> dict[str, str]:
    """Trains what is left of a matrix and shows the progress; returns what failed now and why.

    Args:
        cells: of the matrix; their datasets and encoders are made first, where they are missing.
        results: where all of it is written.
        make: makes the executor; called if there are any runs to train.
        device: to train encoders on, one of `jbench.names.DEVICES`.
        retry_failed: whether runs that failed before are retried.
        output: to print to.
    """
    _clean(cells, results)
    planned = plan(list(all_runs(cells)), results)
    show_plan(planned, retry_failed, output)
    to_do = planned.to_do(retry_failed)
    if not to_do:
        return {}
    wanted = {run.encoder for run in to_do}
    encoders = missing_encoders((c for c in cells if c.runs[0].encoder in wanted), results)
    with _document_alone(output), closing(make()) as executor:
        show = _shown(output)
        unmade: dict[str, str] = {}
        for dataset in _datasets(cells).values():
            learned = [encoder for encoder in encoders if encoder.dataset == dataset.id]
            unmade |= prepare(learned, dataset, results, cores(), device, show, output.say)
        failures = {run.id: unmade[run.encoder] for run in to_do if run.encoder in unmade}
        for encoder, reason in unmade.items():
            output.warn(f"the runs on {encoder} are left out: {reason}")
        left = [run for run in to_do if run.id not in failures]
        with sweep_view(left, output) as view:
            return failures | sweep(left, results, executor, view, planned.ids("failed"))


def _datasets(cells: Sequence[Cell]) -> dict[str, DatasetSettings]:
    """Returns the datasets of the parts that some cells are of, by id."""
    return {dataset.id: dataset for dataset in (cell.part.dataset_settings for cell in cells)}


def _clean(cells: Sequence[Cell], results: Results) -> None:
    """Removes what an interrupted sweep left in records that are finished, and not made again."""
    for id in _datasets(cells):
        results.clean("dataset", id)
    for cell in cells:
        if cell.encoder is not None:
            results.clean("encoder", cell.encoder.id)


def _document_alone(output: Output) -> AbstractContextManager[Any]:
    """Keeps standard output for the document, where there will be one: Ray prints to it."""
    return redirect_stdout(sys.stderr) if output.as_json else nullcontext()


def _shown(output: Output) -> Show:
    @contextmanager
    def show(what: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
        with output.progress(what, total, unit) as progress:
            yield progress.update

    return show


def show_missing(cells: Sequence[Cell], results: Results, output: Output) -> list[str]:
    """Says which datasets and encoders are missing and would be made first; returns their ids."""
    encoders = missing_encoders(cells, results)
    wanted = {encoder.dataset for encoder in encoders}
    missing = []
    for dataset in _datasets(cells).values():
        if dataset.id in wanted and missing_dataset(dataset, results):
            missing.append(dataset.id)
            output.say(f"Made first: the dataset {dataset.id} of {dataset.steps:,} control steps.")
    if encoders:
        output.say(f"Made first: the encoders {', '.join(encoder.id for encoder in encoders)}.")
    return [*missing, *(encoder.id for encoder in encoders)]


def show_matrix(
    title: str, statuses: Sequence[CellStatus], jobs: int, times: bool, output: Output
) -> None:
    """Prints a matrix: how many seeds of each cell are finished, and what is left.

    Args:
        title: of the table.
        statuses: of the cells.
        jobs: processes at a time.
        times: whether to say how long the rest takes.
        output: to print to.
    """
    varied = [
        name for name in _SHOWN_IF_VARIED if len({_of_part(each, name) for each in statuses}) > 1
    ]
    header = ["task", "algo", "representation", *varied]
    header += ["finished", "partial", "failed", "missing"]
    rows: list[list[object]] = [
        [
            *(each.cell.task, each.cell.algo, each.cell.representation),
            *(_of_part(each, name) for name in varied),
            *(each.finished, each.partial, each.failed, each.missing),
        ]
        for each in statuses
    ]
    if times:
        header += ["time left", "estimated from"]
        for row, each in zip(rows, statuses, strict=True):
            row += [_time(each.seconds_left) if each.steps_left else "", each.estimate]
    output.table(title, header, rows)
    if times and any(each.steps_left for each in statuses):
        output.say(
            f"Time left with {jobs} processes at a time: "
            f"{_time(seconds_left(statuses, jobs))}, the failed runs included."
        )


_SHOWN_IF_VARIED = ("settings", "precision", "environments", "time_limit", "steps")


def _of_part(each: CellStatus, name: str) -> str:
    value = getattr(each.cell.part, name)
    return f"{value:,}" if isinstance(value, int) else str(value or "")


def described(statuses: Sequence[CellStatus]) -> list[dict[str, Any]]:
    """Returns what the JSON document says of the cells."""
    return [
        {
            "task": each.cell.task,
            "algo": each.cell.algo,
            "representation": each.cell.representation,
            "encoder": each.cell.runs[0].encoder,
            "settings": each.cell.part.settings,
            "steps": each.cell.part.steps,
            "runs": [run.id for run in each.cell.runs],
            "finished": each.finished,
            "partial": each.partial,
            "failed": each.failed,
            "missing": each.missing,
            "steps_left": each.steps_left,
            "seconds_left": each.seconds_left,
            "estimate": each.estimate,
        }
        for each in statuses
    ]


def _time(seconds: float | None) -> str:
    return "unknown" if seconds is None else duration(seconds)
