"""Trains the runs of cells: `jbench train` has one cell, `jbench sweep` all cells of a matrix.

In Python, a sweep is `sweep(matrix_cells(read_matrix("smoke"), results), results)`.

Processes coordinate only through the results: a run belongs to the process that holds its lock, and
its manifest has its status. Several sweeps of a matrix thus share the work, also on other machines.
"""

import queue
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

from jbench.settings.run import RunSettings
from jbench.store import Results, locks
from jbench.store.files import make_directory
from jbench.store.follow import POLL_SECONDS
from jbench.sweeps.batches import batches
from jbench.sweeps.cell import Cell, all_runs, with_runs
from jbench.sweeps.cluster import Ray
from jbench.sweeps.executors import Local
from jbench.sweeps.forecasts import forecasts
from jbench.sweeps.preparation import prepare
from jbench.tasks.find import checked_task
from jbench.tasks.task import DOES_NOT_REPEAT
from jbench.training.continuation import new_beginnings
from jbench.training.events import (
    Event,
    Failed,
    Finished,
    Held,
    LastEvent,
    Note,
    ProcessEnded,
    ProcessStarted,
    Report,
    Resumed,
    TrainingBegan,
    Warned,
    ignore,
)
from jbench.training.status import (
    failures_among,
    record_failure,
    run_status,
    run_statuses,
    sentences,
)

Executor: TypeAlias = Local | Ray  # its `train` is called from threads, `jobs` at a time
_Future: TypeAlias = Future[list[RunSettings]]

_MAX_DEATHS = 3  # a run fails when this many of its processes have died


def sweep(
    cells: Sequence[Cell],
    results: Results,
    make_executor: Callable[[], Executor] | None = None,
    report: Report = ignore,
    *,
    device: str = "auto",
    retry_failed: bool = False,
    wait: bool = True,
) -> dict[str, str]:
    """Trains the missing runs of cells until each is finished or failed.

    Missing datasets and encoders are made first, on the device. A failed run does not stop the
    others. A run whose process dies is resumed, and counts as failed when its third process dies,
    which it shares with no other run.

    Args:
        make_executor: called if there are runs to train; None for `Local`, a process per core.
        report: takes each `Event`, in the thread that called this.
        retry_failed: whether to retry runs that failed before, unless they must fail again.
        wait: whether to wait for runs that another process is training, and to resume them if
            that process dies.

    Returns a sentence for each run that failed, by run id. Raises a RequestError if the executor
    can't be made, the results can't be written to, or jbench can't use the task of a new run, and a
    WorkError if a process can't be started.
    """
    # An interrupted sweep may have left temporary files.
    for encoder in {encoder.id: encoder for cell in cells for encoder in cell.encoders}.values():
        results.clean("dataset", encoder.dataset)
        results.clean("encoder", encoder.id)

    for run in all_runs(cells):
        results.clean("run", run.id)

    statuses = run_statuses(all_runs(cells), results, device)
    notes = dict.fromkeys(note for cell in cells for note in cell.notes)
    waiting = {id for id, run in statuses.items() if run.state not in ("finished", "failed")}
    if retry_failed:
        failed = failures_among(statuses)
        waiting |= {id for id in failed if not statuses[id].fails_again}

    cells = with_runs(cells, waiting)
    new = [run for run in all_runs(cells) if statuses[run.id].state == "missing"]
    for sentence in (*notes, *sentences(statuses, retry_failed), *new_beginnings(new, results)):
        report(Note(sentence))

    if not cells:
        return {}

    for name in dict.fromkeys(run.task for run in new):
        if not checked_task(name).repeats():
            report(Warned(f"{name}: {DOES_NOT_REPEAT}."))

    make_directory(results.folder("run", cells[0].runs[0].id).path)
    executor = make_executor() if make_executor else Local(results)
    pool = ThreadPoolExecutor(executor.jobs)
    try:
        failures = prepare(cells, results, device, report)
        cells = with_runs(cells, statuses.keys() - failures.keys())
        runs = all_runs(cells)
        if runs:
            if isinstance(executor, Local):
                for sentence in forecasts(cells, results, executor):
                    report(Note(sentence))
            report(TrainingBegan(runs))
            retry = failures_among(statuses)
            scheduler = _Scheduler(results, executor, pool, report, retry=retry, wait=wait)
            failures |= scheduler.train(runs)

        return failures
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        executor.stop()
        pool.shutdown()


@dataclass(frozen=True)
class _Elsewhere:
    """Runs of a batch that another process is training."""

    runs: Sequence[RunSettings]


class _Scheduler:
    """Trains batches of runs, each in a thread, which sends events; one thread decides."""

    def __init__(
        self,
        results: Results,
        executor: Executor,
        pool: ThreadPoolExecutor,
        report: Report,
        *,
        retry: Collection[str],
        wait: bool,
    ) -> None:
        """Trains nothing yet; `retry` are ids of failed runs to try again."""
        self._results = results
        self._executor = executor
        self._pool = pool
        self._report = report
        self._retry = retry
        self._wait = wait
        self._futures: set[_Future] = set()
        self._deaths: Counter[str] = Counter()  # of the processes of a run, by its id
        self._events: queue.SimpleQueue[Event | _Elsewhere | _Future] = queue.SimpleQueue()
        self._elsewhere: set[str] = set()
        self._failures: dict[str, str] = {}
        self._tracebacks = {""}  # those that were shown

    def train(self, runs: Sequence[RunSettings]) -> dict[str, str]:
        """Trains runs; returns a sentence for each that failed, by run id."""
        self._submit(batches(runs, self._executor.jobs, self._executor.device))
        while self._futures:
            with suppress(queue.Empty):  # on Windows, Ctrl-C is seen only between two calls
                self._handle(self._events.get(timeout=POLL_SECONDS))
        return self._failures

    def _submit(self, groups: Iterable[Sequence[RunSettings]]) -> None:
        """Starts a worker for each batch, as soon as one is free."""
        for batch in groups:
            future = self._pool.submit(self._train_batch, batch)
            self._futures.add(future)
            future.add_done_callback(self._events.put)

    def _train_batch(self, batch: Sequence[RunSettings]) -> list[RunSettings]:
        """Trains runs that need it, in a thread; returns those whose process died."""
        left: dict[str, RunSettings] = {}
        held: list[RunSettings] = []
        for run in batch:
            status = run_status(run, self._results)
            if status.state == "failed" and run.id not in self._retry:
                self._events.put(Failed(run.id, status.error))
            elif status.state == "finished":
                self._events.put(Finished(run.id))
            elif locks.is_held(self._results.folder("run", run.id).path):
                held.append(run)
            else:
                left[run.id] = run

        if held:
            if self._elsewhere.issuperset(run.id for run in held):
                time.sleep(POLL_SECONDS)  # another look at them
            self._events.put(_Elsewhere(held))

        if left:
            runs = list(left.values())
            self._events.put(ProcessStarted(runs))
            for event in self._executor.train(runs):
                if isinstance(event, Held):
                    self._events.put(_Elsewhere([left.pop(event.run)]))
                    continue
                if isinstance(event, LastEvent):
                    del left[event.run]
                self._events.put(event)
            self._events.put(ProcessEnded(runs))

        return list(left.values())

    def _handle(self, event: Event | _Elsewhere | _Future) -> None:
        """Reports an event; tries runs of a dead worker again, and leaves those held elsewhere."""
        if isinstance(event, Future):
            self._futures.remove(event)
            died = event.result()
            if died:
                self._try_again(died)
        elif isinstance(event, _Elsewhere):
            self._leave(event.runs)
        else:
            self._report(event)
            if isinstance(event, Resumed):
                self._report(Note(event.sentence))
            elif isinstance(event, Failed):
                self._failures[event.run] = event.reason
                # Runs often fail for the same reason, whose traceback is shown once.
                details = "" if event.traceback in self._tracebacks else f"\n{event.traceback}"
                self._tracebacks.add(event.traceback)
                self._report(Warned(f"the run {event.run} failed: {event.reason}{details}"))

    def _try_again(self, runs: Sequence[RunSettings]) -> None:
        """Trains runs again whose process died, unless that happened too often."""
        self._deaths.update(run.id for run in runs)
        deaths = max(self._deaths[run.id] for run in runs)
        if deaths < _MAX_DEATHS:
            # At last each is alone, so that a run that kills its process fails no other run.
            alone = len(runs) > 1 and deaths == _MAX_DEATHS - 1
            self._submit([[run] for run in runs] if alone else [runs])
            how = f"{_it_is(runs)} tried again"
            if alone:
                how = "each is tried again in a process of its own"
            self._report(Note(f"The process of {_named(runs)} died; {how}."))
            return

        reason = f"its process died without a message, {deaths} times"
        for run in runs:
            record_failure(run, self._results, reason)
            self._handle(Failed(run.id, reason))

    def _leave(self, runs: Sequence[RunSettings]) -> None:
        """Leaves runs to the process that is training them, and looks at them again at the end."""
        new = [run for run in runs if run.id not in self._elsewhere]
        if new:
            then = "waited for at the end" if self._wait else "left out here"
            self._report(Note(f"Another process is training {_named(new)}; {_it_is(new)} {then}."))
            self._elsewhere.update(run.id for run in new)

        if self._wait:
            self._submit([runs])


def _named(runs: Sequence[RunSettings]) -> str:
    """Names runs of a process, such as `seeds 0, 1, 4 of td3 face_direction full`."""
    seeds = ", ".join(str(run.seed) for run in runs)
    cell = f"{runs[0].algo} {runs[0].task} {runs[0].representation}"
    return f"{'seed' if len(runs) == 1 else 'seeds'} {seeds} of {cell}"


def _it_is(runs: Sequence[RunSettings]) -> str:
    """Returns the pronoun for runs, with its verb."""
    return "it is" if len(runs) == 1 else "they are"
