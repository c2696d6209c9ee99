"""Copying committed rows to the logger of an experiment tracker."""

import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

from jbench.errors import RequestError
from jbench.loggers.trackers import Point, TensorBoard, Trackio, WeightsAndBiases
from jbench.store import Results
from jbench.store.follow import LOOK_EVERY, Change, Follower, grouped
from jbench.store.schema import LOSSES

_Rows = Sequence[Mapping[str, Any]]
_Values = Iterator[tuple[str, float | None]]


class Logger(Protocol):
    """Writes runs to a tracker.

    Attributes:
        where: where the log can be seen, as a sentence.
    """

    where: str

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Starts the log of a run; it replaces an earlier log of the same run."""

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds points to the log of a run that was started."""

    def end(self, run: str) -> None:
        """Ends the log of a run, if it was started."""


_TRACKERS: dict[str, Callable[[Path], Logger]] = {
    "tensorboard": TensorBoard,
    "trackio": Trackio,
    "wandb": WeightsAndBiases,
}


def make_logger(name: str, results: Path) -> Logger:
    """Returns the logger of a tracker (`names.LOGGERS`); its files are in the results directory.

    Raises:
        RequestError: if its library is not installed.
    """
    try:
        return _TRACKERS[name](results / name)
    except ImportError as error:
        raise RequestError(
            f"--log {name} needs the package {error.name or name}; type pip install "
            f"'jbench[{name}]'."
        ) from None


def points(change: Change) -> list[Point]:
    """Returns a point for each episode, evaluation and logged step, without unknown values.

    The time is that of the run's creation plus the wall time of its training, so the time between
    the processes of a resumed run is left out.
    """
    created = datetime.fromisoformat(change.record.manifest.created).timestamp()
    made = []
    for table, rows in grouped(change.rows):
        values = dict(_VALUES[table](rows))
        seconds = created + (rows[0]["wall_time"] or 0.0)
        known = {name: value for name, value in values.items() if value is not None}
        made.append(Point(rows[0]["control_steps"], seconds, known))
    return made


def _episode(rows: _Rows) -> _Values:
    (row,) = rows
    yield "training/episode_return", row["episode_return"]
    for name in LOSSES:
        yield f"losses/{name}", row[name]


def _evaluation(rows: _Rows) -> _Values:
    returns = [row["episode_return"] for row in rows]
    yield "evaluation/mean_return", None if None in returns else sum(returns) / len(returns)


def _metrics(rows: _Rows) -> _Values:
    for row in rows:
        yield f"metrics/{row['name']}", row["value"]


_VALUES = {"episodes": _episode, "evaluations": _evaluation, "metrics": _metrics}


@contextmanager
def copying_rows(
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
