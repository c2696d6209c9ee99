"""Copies committed rows to a logger while runs are trained."""

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from jbench.loggers.logger import Logger, points
from jbench.store import Results
from jbench.store.follow import LOOK_EVERY, Follower


@contextmanager
def mirrored(
    results: Results, runs: Collection[str], logger: Logger, warn: Callable[[str], None]
) -> Iterator[None]:
    """Copies the rows of runs to a logger during the block, and what is left at its end.

    The whole of each run is copied, so that the log of a resumed run is complete. A thread reads
    the results as any other reader would; training does not depend on the tracker, and its failure
    ends only the copying.

    Args:
        warn: called with a sentence if a run can't be read or the logger fails.
    """
    done = threading.Event()
    follower = Follower(results, {"run": set(runs)})

    def copy_until_done() -> None:
        started: set[str] = set()
        try:
            is_last = False
            while not is_last:
                is_last = done.wait(LOOK_EVERY)
                _copy(follower, logger, started, warn)
            for run in started:
                logger.end(run)
        except Exception as error:
            reason = str(error) or type(error).__name__
            warn(f"Logging has stopped ({reason}); the training is not affected.")

    thread = threading.Thread(target=copy_until_done, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _copy(
    follower: Follower, logger: Logger, started: set[str], warn: Callable[[str], None]
) -> None:
    for change in follower.look():
        if isinstance(change, str):
            warn(change)
            continue
        run = change.record.id
        if change.is_new:
            logger.start(run, change.record.settings)
            started.add(run)
        logger.log(run, points(change))
        if change.record.status == "finished":
            logger.end(run)
            started.discard(run)
