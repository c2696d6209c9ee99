"""What a command prints when Ctrl-C stops it: what is saved, and what repeating it does."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jbench.names import PAGE
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.wording import are, counted

if TYPE_CHECKING:
    from jbench.encoders.settings import EncoderSettings
    from jbench.store import Results
    from jbench.sweeps.cell import Cell

_BEGINS_AGAIN = "the same command begins again."
_CONTINUES = "the same command continues there."


def stopped_collection(settings: DatasetSettings, results: "Results") -> str:
    """Returns what is said of a dataset whose collection was stopped."""
    from jbench.datasets.by_robot import recorded_layout

    begun = results.find("dataset", settings.id)
    steps = 0
    if begun is not None:
        steps = recorded_layout(begun).control_steps(begun)
    if not steps:
        return f"No control step is kept yet; {_BEGINS_AGAIN}"

    return f"{steps:,} of {settings.steps:,} control steps are kept; {_CONTINUES}"


def stopped_encoders(encoders: Sequence["EncoderSettings"], results: "Results") -> str:
    """Returns what is said of encoders whose training was stopped."""
    from jbench.encoders.loop import CHECKPOINT

    records = [results.find("encoder", encoder.id) for encoder in encoders]
    finished = sum(record is not None and record.is_finished for record in records)
    begun = [record for record in records if record is not None and CHECKPOINT in record.roles()]
    if finished:
        return _saved_records("encoder", len(encoders), finished, len(begun))
    if not begun:
        return f"No epoch is kept yet; {_BEGINS_AGAIN}"

    epochs = begun[0].rows("encoder_epochs")
    planned = begun[0].settings["options"]["epochs"]
    done = f"{epochs:,} of {counted(planned, 'epoch')}"
    if len(encoders) > 1:
        done += f" of {begun[0].id}"
    return f"{done} are kept; {_CONTINUES}"


def stopped_runs(runs: Sequence[RunSettings], results: "Results") -> str:
    """Returns what is said of runs whose training was stopped."""
    from jbench.training.status import run_statuses

    statuses = run_statuses(runs, results).values()
    finished = sum(status.state == "finished" for status in statuses)
    begun = sum(status.state == "unfinished" for status in statuses)
    if not finished and not begun:
        return f"No run has begun yet; {_BEGINS_AGAIN}"

    return _saved_records("run", len(runs), finished, begun)


def stopped_cells(cells: Sequence["Cell"], results: "Results") -> str:
    """Returns what is said of cells, whose datasets and encoders are made before their runs."""
    from jbench.sweeps.cell import all_runs
    from jbench.sweeps.preparation import missing_encoders
    from jbench.training.status import run_statuses

    runs = all_runs(cells)
    if any(status.state != "missing" for status in run_statuses(runs, results).values()):
        return stopped_runs(runs, results)

    for dataset, encoders in missing_encoders(cells, results):
        if not results.is_finished("dataset", dataset.id):
            collected = stopped_collection(dataset, results)
            return f"No run has begun: the dataset is made first. {collected}"
        return f"No run has begun: encoders are made first. {stopped_encoders(encoders, results)}"

    return stopped_runs(runs, results)


def stopped_report(out: Path) -> str:
    """Returns what is said of a report whose writing was stopped."""
    if not (out / PAGE).exists():
        return "No report is written yet; the same command begins again."

    return f"The earlier report in {out} is still there; the same command writes the new one."


def _saved_records(noun: str, count: int, finished: int, begun: int) -> str:
    """Returns how many of several records are finished and begun, and what becomes of the others.

    Some are finished or begun.
    """
    if finished == count:
        return f"{counted(count, noun)} {are(count)} finished."

    effect = "trains the others"
    if begun == 1:
        effect = "continues it from its last checkpoint"
    elif begun > 1:
        effect = "continues each of these from its last checkpoint"

    return (
        f"Of {counted(count, noun)}, {finished} {are(finished)} finished and {begun} begun; "
        f"the same command {effect}."
    )
