"""Tables of a sweep's status, of what it needs, and of the analyses of `--until-decided`."""

from collections.abc import Container, Sequence
from typing import Any

from jbench.commands.output import Output
from jbench.report.analysis.claims import MARGIN
from jbench.statistics import sequential
from jbench.store import Results
from jbench.sweeps.cell import Cell
from jbench.sweeps.cell_status import CellStatus, cell_statuses, seconds_left
from jbench.sweeps.comparisons import MatrixComparison
from jbench.sweeps.deciding import ComparisonOutcome
from jbench.sweeps.prepare import is_finished, missing_encoders
from jbench.wording import counted, duration


def show_missing(cells: Sequence[Cell], results: Results, output: Output) -> list[str]:
    """Prints the datasets and encoders that are made first; returns their ids."""
    missing = missing_encoders(cells, results)
    datasets = [
        dataset for dataset, _ in missing if not is_finished(results, "dataset", dataset.id)
    ]
    encoders = [encoder for _, unfinished in missing for encoder in unfinished]
    for dataset in datasets:
        output.say(f"Collected first: the dataset {dataset.id} of {dataset.steps:,} control steps.")
    if encoders:
        noun = "encoder" if len(encoders) == 1 else "encoders"
        output.say(f"Trained first: the {noun} {', '.join(encoder.id for encoder in encoders)}.")
    return [*(dataset.id for dataset in datasets), *(encoder.id for encoder in encoders)]


def show_status(
    title: str,
    cells: Sequence[Cell],
    results: Results,
    jobs: int,
    device: str,
    output: Output,
    *,
    times: bool,
) -> dict[str, Any]:
    """Prints how many seeds of each configuration are finished, and on request the time left.

    Args:
        jobs: number of processes at a time.
        device: of the batched engine.

    Returns:
        The same for the JSON document.
    """
    statuses = cell_statuses(cells, results, jobs, device, quick=times)
    rows, left = _described(statuses), seconds_left(statuses, jobs)
    if_varied = ("settings", "precision", "environments", "time_limit", "steps")
    varied = (name for name in if_varied if len({row[name] for row in rows}) > 1)
    header = ["task", "algo", "representation", *varied]
    header += ["finished", "partial", "failed", "missing"]

    def text(value: Any) -> str:
        return f"{value:,}" if isinstance(value, int) else value or ""

    texts = [[text(row[name]) for name in header] for row in rows]
    if times:
        header += ["time left", "estimated from"]
        for line, row in zip(texts, rows, strict=True):
            seconds = row["seconds_left"]
            line += [_time(seconds) if row["steps_left"] else "", row["estimate"]]
    output.table(title, header, texts)
    if times and any(status.steps_left for status in statuses):
        failed = ", the failed runs included" if any(status.failed for status in statuses) else ""
        until = " until each configuration has a finished run" if left is None else failed
        processes = counted(jobs, "process", "processes")
        output.say(f"Time left with {processes} at a time: {_time(left)}{until}.")
    return {"configurations": rows, "seconds_left": left}


def _described(statuses: Sequence[CellStatus]) -> list[dict[str, Any]]:
    """Returns the entries of configurations in the JSON document, and the rows of the table."""
    entries = []
    for status in statuses:
        cell, run = status.cell, status.cell.runs[0]
        entry = {
            "task": cell.task,
            "algo": cell.algo,
            "representation": cell.representation,
            "encoder": run.encoder,
            "settings": cell.settings,
            "precision": run.precision,
            "environments": run.parallel,
            "time_limit": run.time_limit,
            "steps": run.steps,
            "runs": [run.id for run in cell.runs],
        }
        numbers = status._asdict().items()
        entries.append(entry | {name: value for name, value in numbers if name != "cell"})
    return entries


def _time(seconds: float | None) -> str:
    return "unknown" if seconds is None else duration(seconds)


def introduction(chosen: Sequence[MatrixComparison], max_seeds: int) -> str:
    """Returns the sentence on the comparisons and their error rate, before they are decided."""
    shares = [comparison.share for comparison in chosen]
    rates = dict.fromkeys(f"{share:.2%}" for share in (min(shares), max(shares)))
    return (
        f"Final returns are compared after each {sequential.BLOCK} seeds, up to {max_seeds}. Of "
        f"all {len(chosen)} decisions together one or more are wrong with a probability of at most "
        f"{sequential.ERROR_RATE:.0%}: {' to '.join(rates)} for each comparison, and more after "
        "others have found a difference."
    )


_VERDICTS = {
    "larger": "higher",
    "smaller": "lower",
    "equal": f"similar, within {MARGIN:g}",
    "undecided": "undecided",
}


def show_outcomes(
    outcomes: Sequence[ComparisonOutcome], tried: Container[str], output: Output
) -> None:
    """Prints each comparison's decision, its number of seeds, and the error rate spent.

    Args:
        tried: ids of the runs that were trained, finished or not.
    """
    rows: list[tuple[object, ...]] = []
    for outcome in outcomes:
        decision, verdict = outcome.decision, _VERDICTS[outcome.decision.verdict]
        left = [run.id for run in outcome.needed if run.id in tried]
        if left:
            verdict += f": {left[0]} is not finished"
        numbers = ("", "")
        if decision.seeds:
            interval = f"[{decision.low:+.0f}, {decision.high:+.0f}]"
            numbers = f"{decision.difference:+.0f}", interval
        spent = f"{decision.spent:.2%}"
        rows.append((outcome.comparison.name, verdict, decision.seeds, *numbers, spent))
    decided = sum(outcome.decision.verdict != "undecided" for outcome in outcomes)
    header = ("comparison", "verdict", "seeds", "difference", "interval", "error spent")
    output.table(f"Comparisons decided: {decided} of {len(rows)}", header, rows)


def described_outcomes(outcomes: Sequence[ComparisonOutcome]) -> list[dict[str, Any]]:
    """Returns the entries of comparisons in the JSON document."""
    return [
        {
            "comparison": outcome.comparison.name,
            "task": outcome.comparison.ours.task,
            "algo": outcome.comparison.ours.algo,
            "representation": outcome.comparison.ours.representation,
            "against": outcome.comparison.against,
            "claim": outcome.comparison.claim,
            "share": outcome.comparison.share,
            **outcome.decision._asdict(),
            "needed": [run.id for run in outcome.needed],
        }
        for outcome in outcomes
    ]
