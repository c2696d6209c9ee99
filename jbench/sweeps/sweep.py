"""The runs of a matrix, until all are finished or failed, here or in another process.

The results are all that is shared: a run is taken by its lock, and done when its manifest says so.
Two sweeps of the same matrix, on one machine or on several, share the work in this way.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Collection, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import Protocol

from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.sweeps.executors import Executor
from jbench.training.processes import Message
from jbench.training.status import is_elsewhere, record_failure, run_status
from jbench.training.train import batches

_LOOK_EVERY = 2.0  # s between two looks at the runs that another process does
_MOST_DEATHS = 3  # of the processes of a run, before it counts as failed


class Watch(Protocol):
    """What is told of a sweep while it goes on, one call at a time."""

    def begins(self, runs: Sequence[RunSettings]) -> None:
        """These runs go to a process."""

    def says(self, run: RunSettings, message: Message) -> None:
        """The process says something of a run; see `jbench.training.worker`."""

    def ends(self, runs: Sequence[RunSettings]) -> None:
        """The process of these runs has ended, whatever became of them."""

    def note(self, sentence: str) -> None:
        """Something happened that a person wants to know."""


def sweep(
    runs: Sequence[RunSettings],
    results: Results,
    executor: Executor,
    watch: Watch,
    again: Collection[str] = (),
) -> dict[str, str]:
    """Does runs until each is finished or failed.

    A run that another process does is left to it; it is waited for at the end, and taken over if
    that process dies. A run whose own process dies is done again, three times at most.

    Args:
        runs: that are not finished.
        results: where they go.
        executor: what does them.
        watch: told of what happens.
        again: ids of those that are done although they have failed before.

    Returns:
        A sentence for each run that failed, by its id.

    Raises:
        WorkError: if a process can't be started.
    """
    work = _Work(runs, results, executor, watch, again)
    jobs = max(1, min(executor.jobs, len(runs)))
    pool = ThreadPoolExecutor(jobs)
    try:
        threads = [pool.submit(work.run) for _ in range(jobs)]
        wait(threads, return_when=FIRST_EXCEPTION)
        for thread in threads:
            thread.result()
    finally:
        # After Ctrl-C or an error, runs are still being trained.
        work.stop()
        executor.stop()
        pool.shutdown(cancel_futures=True)
    return work.failures


class _Work:
    """What is left of a sweep; any number of threads take of it."""

    def __init__(
        self,
        runs: Sequence[RunSettings],
        results: Results,
        executor: Executor,
        watch: Watch,
        again: Collection[str],
    ) -> None:
        self._results, self._executor, self._watch = results, executor, watch
        self._again = set(again)
        self._waiting = deque(batches(runs, executor.jobs, executor.device))
        self._elsewhere: dict[str, RunSettings] = {}
        self._under_way, self._stopped = 0, False
        self._looked = time.monotonic()
        self._deaths: Counter[str] = Counter()
        self.failures: dict[str, str] = {}
        self._changed = threading.Condition()

    def run(self) -> None:
        """Does batch after batch until nothing is left."""
        while (batch := self._next()) is not None:
            try:
                self._do(batch)
            finally:
                with self._changed:
                    self._under_way -= 1
                    self._watch.ends(batch)
                    self._changed.notify_all()

    def stop(self) -> None:
        """Lets no thread begin anything any more."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _next(self) -> list[RunSettings] | None:
        """Returns what to do next, once there is something; None at the end."""
        with self._changed:
            while not self._stopped:
                while self._waiting:
                    batch = self._to_do(self._waiting.popleft())
                    if batch:
                        self._under_way += 1
                        self._watch.begins(batch)
                        return batch
                if not self._elsewhere and not self._under_way:
                    return None
                self._changed.wait(_LOOK_EVERY)
                if time.monotonic() - self._looked >= _LOOK_EVERY:
                    self._look_elsewhere()
            return None

    def _do(self, batch: Sequence[RunSettings]) -> None:
        """Does runs in a process of theirs."""
        by_id = {run.id: run for run in batch}
        left = dict(by_id)
        for message in self._executor.do(batch):
            with self._changed:
                run = by_id[message.get("run", batch[0].id)]
                self._watch.says(run, message)
                if "finished" in message:
                    left.pop(run.id, None)
                elif message.get("held"):
                    left.pop(run.id, None)
                    self._leave([run])
                elif "failed" in message:
                    left.pop(run.id, None)
                    self._fail(run, message["failed"])
        with self._changed:
            if left and not self._stopped:
                self._died(list(left.values()))

    def _to_do(self, batch: Sequence[RunSettings]) -> list[RunSettings]:
        """Returns those of some runs that nobody has done, or does."""
        mine, others = [], []
        for run in batch:
            found = run_status(run, self._results)
            if found.state == "failed" and run.id not in self._again:
                self._fail(run, found.error)
            elif found.state == "finished":
                self._watch.says(run, {"run": run.id, "finished": True})
            elif is_elsewhere(run, self._results):
                others.append(run)
            else:
                mine.append(run)
        self._leave(others)
        # Once more, and no more: then what it comes to is what it is.
        self._again -= {run.id for run in mine}
        return mine

    def _leave(self, runs: Sequence[RunSettings]) -> None:
        """Leaves runs to the process that does them."""
        for run in runs:
            self._elsewhere[run.id] = run
        if runs:
            self._watch.note(
                f"{_named(runs)} of {runs[0].algo} {runs[0].task} {runs[0].representation}: "
                "another process does it; it is waited for at the end."
            )

    def _look_elsewhere(self) -> None:
        """Takes back what another process has left, finished or not."""
        self._looked = time.monotonic()
        free = [run for run in self._elsewhere.values() if self._is_free(run)]
        for run in free:
            del self._elsewhere[run.id]
        self._waiting.extend(batches(free, self._executor.jobs, self._executor.device))

    def _is_free(self, run: RunSettings) -> bool:
        ended = run_status(run, self._results).state in ("finished", "failed")
        return ended or not is_elsewhere(run, self._results)

    def _died(self, runs: Sequence[RunSettings]) -> None:
        """Does runs again whose process died, unless it died too often."""
        again = []
        for run in runs:
            self._deaths[run.id] += 1
            if self._deaths[run.id] < _MOST_DEATHS:
                again.append(run)
            else:
                reason = f"its process died without a word, {_MOST_DEATHS} times"
                record_failure(run, self._results, reason)
                self._fail(run, reason)
        if again:
            # One that failed before may have died before it was begun again.
            self._again |= {run.id for run in again}
            self._waiting.append(again)
            self._watch.note(
                f"The process of {_named(again)} of {again[0].algo} {again[0].task} "
                f"{again[0].representation} died; they are tried again."
            )

    def _fail(self, run: RunSettings, reason: str) -> None:
        if run.id not in self.failures:
            self.failures[run.id] = reason
            self._watch.says(run, {"run": run.id, "failed": reason})
            self._watch.note(f"The run {run.id} failed: {reason}")


def _named(runs: Sequence[RunSettings]) -> str:
    """Returns what a sentence calls runs of one cell: `seed 3`, `seeds 0, 1, 4`."""
    seeds = ", ".join(str(run.seed) for run in runs)
    return f"seed {seeds}" if len(runs) == 1 else f"seeds {seeds}"
