"""Trains the runs of cells: `jbench train` has one cell, `jbench sweep` all cells of a matrix.

In Python, a sweep is:

    from pathlib import Path
    from jbench.sweeps.matrix import matrix_cells, read_matrix
    from jbench.sweeps.scheduler import sweep
    from jbench.store import Results

    results = Results(Path("results"))
    failures = sweep(matrix_cells(read_matrix("smoke"), results), results)

It reports what happens as an `Event` (`jbench.training.events`).

Processes coordinate only through the results: a run belongs to the process that holds its lock, and
its manifest has its status. Several sweeps of the same matrix, on one machine or on several, thus
share the work.
"""

import queue
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress

from jbench.settings.run import RunSettings
from jbench.simulation.find import checked_task
from jbench.store import Results
from jbench.store.files import check_writable
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.cell_status import cell_statuses, forecast
from jbench.sweeps.executors import Executor, Local, batches
from jbench.sweeps.prepare import clean, prepare
from jbench.training.continuation import new_beginnings
from jbench.training.events import Event, Report, ignore
from jbench.training.memory import memory_sentence
from jbench.training.status import is_being_trained, plan, record_failure, run_status

_LOOK_EVERY = 2.0  # s between two looks at the runs that another process is training
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

    Missing datasets and encoders are made first. A failed run does not stop the others. A run
    whose process dies is resumed, and counts as failed when its third process dies, which it shares
    with no other run.

    Args:
        cells: cells of a matrix, or a single one.
        results: where datasets, encoders and runs are written.
        make_executor: called if there are runs to train; None for `Local`, a process per core.
        report: takes what happens, in the thread that called this.
        device: device for training encoders, see `jbench.devices.find_device`.
        retry_failed: whether to retry runs that failed before.
        wait: whether to wait for runs that another process is training, and to resume them if
            that process dies.

    Returns:
        A sentence for each run that failed, by run id.

    Raises:
        RequestError: if the executor can't be made, the results can't be written to, or jbench
            can't use the task of a new run.
        WorkError: if a process can't be started.
    """
    clean(cells, results)
    planned = plan(list(all_runs(cells)), results)
    to_do = planned.to_do(retry_failed)
    new = [run for run in to_do if planned.statuses[run.id].state == "missing"]
    for sentence in (*planned.sentences(retry_failed), *new_beginnings(new, results)):
        report(Event("note", text=sentence))
    if not to_do:
        return {}
    for run in new:
        checked_task(run.task)
    check_writable(results.record("run", to_do[0].id).path)
    with closing(make_executor() if make_executor else Local(results)) as executor:
        failures = prepare(cells, to_do, results, device, report)
        runs = [run for run in to_do if run.id not in failures]
        if not runs:
            return failures
        if isinstance(executor, Local):
            for sentence in filter(None, _forecasts(cells, runs, results, executor)):
                report(Event("note", text=sentence))
        report(Event("training", runs=runs))
        scheduler = _Scheduler(results, executor, report, planned.ids("failed"), wait)
        return failures | scheduler.train(runs)


def _forecasts(
    cells: Sequence[Cell],
    runs: Sequence[RunSettings],
    results: Results,
    executor: Local,
) -> Iterator[str | None]:
    """Yields sentences on the expected memory and time of runs on this machine, if known."""
    waiting = batches(runs, executor.jobs, executor.device)
    jobs = min(executor.jobs, len(waiting))
    yield memory_sentence([r for batch in waiting[:jobs] for r in batch], executor.device)
    ids = {run.id for run in runs}
    left = [cell._replace(runs=[run for run in cell.runs if run.id in ids]) for cell in cells]
    left = [cell for cell in left if cell.runs]
    yield forecast(cell_statuses(left, results, jobs, executor.device), jobs)


class _Scheduler:
    """Gives batches of runs to an executor.

    Each batch has a thread that only forwards the events of its worker. All decisions are made in
    the thread that called `train`.
    """

    def __init__(
        self,
        results: Results,
        executor: Executor,
        report: Report,
        retry: Collection[str],
        wait: bool,
    ) -> None:
        self._results, self._executor, self._report = results, executor, report
        self._retry, self._wait = set(retry), wait
        self._waiting: deque[list[RunSettings]] = deque()
        self._workers = 0
        # Given to a worker, and neither finished nor failed.
        self._open: dict[str, RunSettings] = {}
        self._elsewhere: dict[str, RunSettings] = {}
        self._events: queue.SimpleQueue[tuple[list[RunSettings], Event | Future[None]]] = (
            queue.SimpleQueue()
        )
        self._looked = time.monotonic()
        self._deaths: Counter[str] = Counter()
        self._failures: dict[str, str] = {}
        self._tracebacks = {""}  # those that were shown

    def train(self, runs: Sequence[RunSettings]) -> dict[str, str]:
        """Trains runs; returns a sentence for each that failed, by run id."""
        jobs = max(1, min(self._executor.jobs, len(runs)))
        self._add(runs)
        pool = ThreadPoolExecutor(jobs)
        try:
            while self._waiting or self._workers or self._elsewhere:
                while self._waiting and self._workers < jobs:
                    self._start(self._waiting.popleft(), pool)
                if self._workers or self._elsewhere:
                    self._handle_event()
                if time.monotonic() - self._looked >= _LOOK_EVERY:
                    self._take_back()
        finally:
            # After Ctrl-C or an error, workers are still training.
            self._executor.stop()
            pool.shutdown(cancel_futures=True)
        return self._failures

    def _add(self, runs: Sequence[RunSettings]) -> None:
        self._waiting.extend(batches(runs, self._executor.jobs, self._executor.device))

    def _start(self, batch: Sequence[RunSettings], pool: ThreadPoolExecutor) -> None:
        """Starts a worker for the runs of a batch that still need training."""
        runs = self._to_do(batch)
        if not runs:
            return
        self._workers += 1
        self._open |= {run.id: run for run in runs}
        self._report(Event("started", runs=runs))
        ended = pool.submit(self._forward_events, runs)
        ended.add_done_callback(lambda future: self._events.put((runs, future)))

    def _forward_events(self, runs: list[RunSettings]) -> None:
        for event in self._executor.train(runs):
            self._events.put((runs, event))

    def _to_do(self, batch: Sequence[RunSettings]) -> list[RunSettings]:
        """Returns the runs that no process has finished or is training."""
        mine, others = [], []
        for run in batch:
            status = run_status(run, self._results)
            if status.state == "failed" and run.id not in self._retry:
                self._fail(run, status.error)
            elif status.state == "finished":
                self._report(Event("finished", run.id))
            elif is_being_trained(run, self._results):
                others.append(run)
            else:
                mine.append(run)
        self._leave(others)
        # A run is retried once.
        self._retry -= {run.id for run in mine}
        return mine

    def _handle_event(self) -> None:
        """Handles the next event or end of a worker; returns after `_LOOK_EVERY` without one."""
        with suppress(queue.Empty):
            runs, event = self._events.get(timeout=_LOOK_EVERY)
            if isinstance(event, Future):
                self._end(runs, event)
            else:
                self._handle(next(run for run in runs if run.id == event.run), event)

    def _handle(self, run: RunSettings, event: Event) -> None:
        """Handles the event of a worker."""
        if event.is_last:
            self._open.pop(run.id, None)
        if event.kind == "held":
            self._leave([run])
        elif event.kind == "failed":
            self._fail(run, event.text, event.traceback)
        else:
            self._report(event)
        if event.kind == "resumed":
            self._note(_resume_sentence(event))

    def _end(self, runs: Sequence[RunSettings], worker: Future[None]) -> None:
        """Handles the end of a worker; runs without an outcome are trained again."""
        self._workers -= 1
        self._report(Event("ended", runs=runs))
        worker.result()
        again = []
        for run in (run for run in runs if self._open.pop(run.id, None)):
            self._deaths[run.id] += 1
            if self._deaths[run.id] < _MAX_DEATHS:
                again.append(run)
            else:
                reason = f"its process died without a message, {_MAX_DEATHS} times"
                record_failure(run, self._results, reason)
                self._fail(run, reason)
        if again:
            # A run that failed before may have died before it was started again.
            self._retry |= {run.id for run in again}
            # At last each is alone, so that a run that kills its process fails no other run.
            alone = len(again) > 1 and max(self._deaths[run.id] for run in again) == _MAX_DEATHS - 1
            self._waiting.extend([[run] for run in again] if alone else [again])
            how = "each is tried again in a process of its own" if alone else "they are tried again"
            self._note(f"The process of {_named(again)} died; {how}.")

    def _leave(self, runs: Sequence[RunSettings]) -> None:
        """Leaves runs to the process that is training them."""
        if not runs:
            return
        if self._wait:
            self._elsewhere |= {run.id: run for run in runs}
        then = "waited for at the end" if self._wait else "left out here"
        verb = "it is" if len(runs) == 1 else "they are"
        self._note(f"Another process is training {_named(runs)}; {verb} {then}.")

    def _take_back(self) -> None:
        """Takes back runs that another process has finished, failed or abandoned."""
        self._looked = time.monotonic()
        free = [run for run in self._elsewhere.values() if self._is_free(run)]
        for run in free:
            del self._elsewhere[run.id]
        self._add(free)

    def _is_free(self, run: RunSettings) -> bool:
        return run_status(run, self._results).is_ended or not is_being_trained(run, self._results)

    def _fail(self, run: RunSettings, reason: str, traceback: str = "") -> None:
        self._failures[run.id] = reason
        self._report(Event("failed", run.id, reason))
        # Runs often fail for the same reason, whose traceback is shown once.
        details = "" if traceback in self._tracebacks else f"\n{traceback}"
        self._tracebacks.add(traceback)
        self._report(Event("warning", text=f"the run {run.id} failed: {reason}{details}"))

    def _note(self, sentence: str) -> None:
        self._report(Event("note", text=sentence))


def _resume_sentence(event: Event) -> str:
    steps, other = event.steps, event.continues
    if not other:
        how = "was interrupted or failed; it " + ("resumes at" if steps else "starts again from")
    else:
        how = f"continues {other} from" if steps else f"can't continue {other}; it trains from"
    where = f"control step {steps:,}" if steps else "the beginning"
    return f"The run {event.run} {how} {where}. {event.text}".rstrip()


def _named(runs: Sequence[RunSettings]) -> str:
    """Names runs of a process, such as `seeds 0, 1, 4 of td3 face_direction full`."""
    cells = {(run.task, run.representation) for run in runs}
    if len(cells) > 1:
        return f"{len(runs)} runs of {runs[0].algo} in {len(cells)} configurations"
    seeds = ", ".join(str(run.seed) for run in runs)
    cell = f"{runs[0].algo} {runs[0].task} {runs[0].representation}"
    return f"{'seed' if len(runs) == 1 else 'seeds'} {seeds} of {cell}"
