"""Tables of a sweep's status, and of the datasets and encoders that it needs."""

from collections.abc import Sequence
from typing import Any

from jbench.commands.output import Output
from jbench.store import Results
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.cell_status import CellStatus, cell_statuses, seconds_left
from jbench.sweeps.prepare import is_finished, missing_encoders
from jbench.wording import counted, duration


def show_missing(cells: Sequence[Cell], results: Results, output: Output) -> list[str]:
    """Prints the datasets and encoders that are made first; returns their ids."""
    missing = missing_encoders(cells, results)
    datasets = [
        dataset for dataset, _ in missing if not is_finished(results, "dataset", dataset.id)
    ]
    encoders = [encoder for _, of_dataset in missing for encoder in of_dataset]
    for dataset in datasets:
        output.say(f"Collected first: the dataset {dataset.id} of {dataset.steps:,} control steps.")
    if encoders:
        noun = "encoder" if len(encoders) == 1 else "encoders"
        output.say(f"Trained first: the {noun} {', '.join(encoder.id for encoder in encoders)}.")
    return [*(dataset.id for dataset in datasets), *(encoder.id for encoder in encoders)]


def show_matrix(
    title: str, statuses: Sequence[CellStatus], jobs: int, times: bool, output: Output
) -> None:
    """Prints how many seeds of each configuration are finished, and on request the time left."""
    settings = [_settings(status.cell) for status in statuses]
    varied = [name for name in settings[0] if len({values[name] for values in settings}) > 1]
    header = ["task", "algo", "representation", *varied]
    header += ["finished", "partial", "failed", "missing"]
    rows: list[list[object]] = [
        [
            *(status.cell.task, status.cell.algo, status.cell.representation),
            *(shown[name] for name in varied),
            *(status.finished, status.partial, status.failed, status.missing),
        ]
        for status, shown in zip(statuses, settings, strict=True)
    ]
    if times:
        header += ["time left", "estimated from"]
        for row, status in zip(rows, statuses, strict=True):
            row += [_time(status.seconds_left) if status.steps_left else "", status.estimate]
    output.table(title, header, rows)
    if times and any(status.steps_left for status in statuses):
        failed = ", the failed runs included" if any(status.failed for status in statuses) else ""
        seconds = seconds_left(statuses, jobs)
        until = " until each configuration has a finished run" if seconds is None else failed
        output.say(
            f"Time left with {counted(jobs, 'process', 'processes')} at a time: "
            f"{_time(seconds)}{until}."
        )


def _settings(cell: Cell) -> dict[str, str]:
    """Returns the settings that the table has if they differ between configurations."""
    run = cell.runs[0]
    return {
        "settings": cell.settings,
        "precision": run.precision,
        "environments": "" if run.parallel is None else f"{run.parallel:,}",
        "time_limit": run.time_limit,
        "steps": f"{run.steps:,}",
    }


def show_dry_run(
    cells: Sequence[Cell], results: Results, jobs: int, device: str, output: Output
) -> None:
    """Prints the status of the runs of `jbench train`, and the time left."""
    runs = list(all_runs(cells))
    jobs = min(jobs, len(runs))
    statuses = cell_statuses(cells, results, jobs, device)
    show_matrix(counted(len(runs), "run"), statuses, jobs, True, output)
    left = seconds_left(statuses, jobs)
    output.document({"configurations": described(statuses), "seconds_left": left})


def described(statuses: Sequence[CellStatus]) -> list[dict[str, Any]]:
    """Returns the entries of configurations in the JSON document."""
    return [
        {
            "task": status.cell.task,
            "algo": status.cell.algo,
            "representation": status.cell.representation,
            "encoder": status.cell.runs[0].encoder,
            "settings": status.cell.settings,
            "steps": status.cell.runs[0].steps,
            "runs": [run.id for run in status.cell.runs],
            **{name: value for name, value in status._asdict().items() if name != "cell"},
        }
        for status in statuses
    ]


def _time(seconds: float | None) -> str:
    return "unknown" if seconds is None else duration(seconds)
