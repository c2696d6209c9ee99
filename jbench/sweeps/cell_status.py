"""How far the cells of a matrix are, and how long the rest of their runs will take."""

import statistics
from collections.abc import Sequence
from typing import NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.settings.alike import COST, SEED, alike
from jbench.settings.run import RunSettings, read_run
from jbench.store import Record, Results
from jbench.store.provenance import cores, processor
from jbench.sweeps.cell import Cell
from jbench.training.status import run_status


class CellStatus(NamedTuple):
    """How far a cell is.

    Attributes:
        cell: of a matrix.
        finished, partial, failed, missing: number of seeds.
        steps_left: control steps of all runs that are not finished.
        seconds_left: s on this machine; None if nothing like it has been measured.
        estimate: source of `seconds_left`: "measured runs", "a quick measurement" or "unknown";
            empty if nothing is left.
    """

    cell: Cell
    finished: int
    partial: int
    failed: int
    missing: int
    steps_left: int
    seconds_left: float | None
    estimate: str


def cell_statuses(
    cells: Sequence[Cell], results: Results, jobs: int, device: str = "cpu", quick: bool = True
) -> list[CellStatus]:
    """Returns how far each cell is, and how long the rest of it takes on this machine.

    Args:
        cells: of a matrix.
        results: that hold its runs, and similar finished ones, whose time is known.
        jobs: processes at a time.
        device: of the batched engine.
        quick: whether an algorithm without finished runs is measured now, within seconds.
    """
    measured = _Measured(results)
    quickly: dict[str, float | None] = {}
    told = []
    for cell in cells:
        found = [run_status(run, results) for run in cell.runs]
        states = [each.state for each in found]
        left = sum(each.steps_left for each in found)
        seconds, source = measured.seconds_per_step(cell.runs[0]), "measured runs"
        if seconds is None and left and quick:
            likeness = alike(cell.runs[0], COST)
            if likeness not in quickly:
                quickly[likeness] = _quick_measurement(cell.runs, device)
            seconds, source = quickly[likeness], "a quick measurement"
        if seconds is None:
            source = "unknown"
        told.append(
            CellStatus(
                cell,
                finished=states.count("finished"),
                partial=states.count("partial"),
                failed=states.count("failed"),
                missing=states.count("missing"),
                steps_left=left,
                seconds_left=None if seconds is None else left * seconds / _at_once(cell, jobs),
                estimate=source if left else "",
            )
        )
    return told


def seconds_left(statuses: Sequence[CellStatus], jobs: int) -> float | None:
    """Returns the seconds that cells still take if no process is ever idle; None if unknown."""
    work = 0.0
    for each in statuses:
        if each.seconds_left is None:
            return None
        work += each.seconds_left * _at_once(each.cell, jobs)
    return work / jobs


def _at_once(cell: Cell, jobs: int) -> int:
    """Returns how many processes the seeds of a cell are divided among."""
    return min(jobs, len(cell.runs))


class _Measured:
    """Seconds of a processor core for each control step, from the finished runs of this machine."""

    def __init__(self, results: Results) -> None:
        self._exact: dict[str, list[float]] = {}
        self._alike: dict[str, list[float]] = {}
        for record in results.scan("run")[0]:
            seconds = _core_seconds_per_step(record)
            if seconds is not None:
                run = read_run(record.settings)
                self._exact.setdefault(alike(run, SEED), []).append(seconds)
                self._alike.setdefault(alike(run, COST), []).append(seconds)

    def seconds_per_step(self, run: RunSettings) -> float | None:
        """Returns the median over the runs of the same settings, else over those like them."""
        found = self._exact.get(alike(run, SEED)) or self._alike.get(alike(run, COST))
        return statistics.median(found) if found else None


def _core_seconds_per_step(record: Record) -> float | None:
    """Returns the seconds of a core that a control step of a finished run took, if they are known.

    The runs of a process share its one core, and each has its whole time as its own.
    """
    provenance, summary = record.manifest.provenance, record.manifest.summary
    here = (provenance.get("processor"), provenance.get("cores")) == (processor(), cores())
    time, steps = summary.get("wall_time"), summary.get("steps_done")
    known = isinstance(time, int | float) and isinstance(steps, int | float) and steps > 0
    if record.status != "finished" or not here or not known:
        return None
    together = summary.get("together")
    shared = together if isinstance(together, int) and together > 0 else 1
    return float(time / steps) / shared  # type: ignore[operator]


def _quick_measurement(runs: Sequence[RunSettings], device: str) -> float | None:
    """Returns the seconds of a control step of throw-away agents; None if they can't be made."""
    import torch

    from jbench.training.speed import seconds_per_step

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        # On a GPU the seeds are one stack. A missing encoder costs little beside the learning.
        together = runs if device == "cuda" else runs[:1]
        return seconds_per_step(together, None, device) / len(together)
    except (RequestError, WorkError, RuntimeError):
        return None
    finally:
        torch.set_num_threads(before)
