"""How far the runs of a matrix are, as the results hold them, and how long the rest will take."""

import contextlib
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.alike import COST, SEED, alike
from jbench.settings.run import RunSettings, read_run
from jbench.store import Record, Results, locks
from jbench.store.provenance import cores, processor
from jbench.sweeps.matrix import Cell

State = Literal["finished", "partial", "failed", "missing"]


class RunStatus(NamedTuple):
    """How far a run is.

    Attributes:
        state: of it.
        steps_left: control steps that are still to be done.
        error: of a failed run; what is wrong with a record that can't be read.
    """

    state: State
    steps_left: int
    error: str = ""


class Plan(NamedTuple):
    """The runs of a command, with how far each is before it starts.

    Attributes:
        runs: in the order asked for.
        statuses: by id of the run.
    """

    runs: Sequence[RunSettings]
    statuses: Mapping[str, RunStatus]

    def ids(self, state: State) -> list[str]:
        """Returns the ids of the runs in a state."""
        return [run.id for run in self.runs if self.statuses[run.id].state == state]

    def to_do(self, retry_failed: bool) -> list[RunSettings]:
        """Returns the runs to train: failed ones only if they are retried."""
        done = ("finished",) if retry_failed else ("finished", "failed")
        return [run for run in self.runs if self.statuses[run.id].state not in done]


class CellStatus(NamedTuple):
    """How far a cell is.

    Attributes:
        cell: of the matrix.
        finished, partial, failed, missing: how many of its seeds.
        steps_left: control steps of the runs that are not finished, all together.
        seconds_left: s on this machine; None where nothing like it has been measured.
        estimate: where that is from: "measured runs", "a quick measurement" or "unknown"; empty
            where nothing is left.
    """

    cell: Cell
    finished: int
    partial: int
    failed: int
    missing: int
    steps_left: int
    seconds_left: float | None
    estimate: str


def run_status(run: RunSettings, results: Results) -> RunStatus:
    """Returns how far a run is."""
    try:
        record = results.find("run", run.id)
    except WorkError as error:
        return RunStatus("failed", run.steps, str(error))
    if record is None:
        return RunStatus("missing", run.steps)
    if record.status == "finished":
        return RunStatus("finished", 0)
    done = record.rows("episodes") * EPISODE_STEPS if record.roles() else 0
    left = max(0, run.steps - done)
    if record.status == "failed":
        return RunStatus("failed", left, str(record.manifest.summary.get("error")))
    return RunStatus("partial", left)


def plan(runs: Sequence[RunSettings], results: Results) -> Plan:
    """Returns how far each of some runs is; removes what an interrupted writer left in them."""
    for run in runs:
        results.clean("run", run.id)
    return Plan(runs, {run.id: run_status(run, results) for run in runs})


def is_elsewhere(run: RunSettings, results: Results) -> bool:
    """Returns whether some process does a run at this moment."""
    return locks.is_held(results.record("run", run.id).path)


def record_failure(run: RunSettings, results: Results, reason: str) -> None:
    """Marks a run as failed, unless it is marked already, finished, or another process does it."""
    with contextlib.suppress(RequestError, WorkError), results.locked("run", run.id) as found:
        record = found or results.create("run", run.id, run.model_dump(mode="json"))
        if record.status == "unfinished":
            record.fail(reason)


def cell_statuses(
    cells: Sequence[Cell], results: Results, jobs: int, device: str = "cpu", quick: bool = True
) -> list[CellStatus]:
    """Returns how far each cell is, and how long the rest of it takes this machine.

    Args:
        cells: of a matrix.
        results: that hold its runs, and others like them that were measured.
        jobs: processes that will go on at a time.
        device: that the batched engine will learn on.
        quick: whether what no run has measured is measured now, within seconds for each algorithm.
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
                quickly[likeness] = _quick_measurement(cell.runs[0], device)
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
    """Returns the seconds that a matrix still takes, its processes never idle; None if unknown.

    Args:
        statuses: of its cells.
        jobs: processes at a time.
    """
    work = 0.0
    for each in statuses:
        if each.seconds_left is None:
            return None
        work += each.seconds_left * _at_once(each.cell, jobs)
    return work / jobs


def _at_once(cell: Cell, jobs: int) -> int:
    """Returns how many processes the seeds of a cell are dealt out to."""
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


def _quick_measurement(run: RunSettings, device: str) -> float | None:
    """Returns the seconds of a control step of a throw-away agent; None if it can't be made."""
    import torch

    from jbench.training.speed import seconds_per_step

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        # An encoder may not be there yet; what it costs is little beside the agent's learning.
        return seconds_per_step([run], None, device)
    except (RequestError, WorkError, RuntimeError):
        return None
    finally:
        torch.set_num_threads(before)


def failures_among(runs: Iterable[RunSettings], results: Results) -> dict[str, str]:
    """Returns the errors of those of some runs that have failed, by their ids."""
    found = {run.id: run_status(run, results) for run in runs}
    return {id: each.error for id, each in found.items() if each.state == "failed"}
