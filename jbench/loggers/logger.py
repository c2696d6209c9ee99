"""Copying committed rows to the logger of an experiment tracker."""

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from jbench.errors import RequestError
from jbench.loggers.trackers import Point, TensorBoard, Trackio, WeightsAndBiases
from jbench.store import Results
from jbench.store.follow import LOOK_EVERY, Change, Follower, grouped
from jbench.store.schema import LOSSES

Logger = TensorBoard | Trackio | WeightsAndBiases
"""Starts the log of a run, which replaces an earlier one, adds points, and ends it if started.

`where` is a sentence on where the log can be seen."""

_TRACKERS: dict[str, Callable[[Path], Logger]] = {
    "tensorboard": TensorBoard,
    "trackio": Trackio,
    "wandb": WeightsAndBiases,
}


def make_logger(name: str, results: Path) -> Logger:
    """Returns the logger of a tracker (`names.LOGGERS`); its files are in the results directory."""
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
        first, values = rows[0], dict[str, float | None]()
        if table == "metrics":
            values = {f"metrics/{row['name']}": row["value"] for row in rows}
        elif table == "episodes":
            values = {"training/episode_return": first["episode_return"]}
            values |= {f"losses/{name}": first[name] for name in LOSSES}
        elif None not in (returns := [row["episode_return"] for row in rows]):
            values["evaluation/mean_return"] = sum(returns) / len(returns)
        known = {name: value for name, value in values.items() if value is not None}
        made.append(Point(first["control_steps"], created + (first["wall_time"] or 0.0), known))
    return made


@contextmanager
def copying_rows(
    results: Results, runs: Collection[str], logger: Logger, warn: Callable[[str], None]
) -> Iterator[None]:
    """Copies the rows of runs to a logger during the block, and what is left at its end.

    The whole of each run is copied, so that the log of a resumed run is complete. A thread reads
    the results as any other reader would; training does not depend on the tracker, and its failure
    ends only the copying, with a sentence to `warn`.
    """
    done = threading.Event()
    follower = Follower(results, {"run": set(runs)})

    def copy_until_done() -> None:
        try:
            while not done.wait(LOOK_EVERY):
                _copy(follower, logger, warn)
            _copy(follower, logger, warn)
            for run in runs:
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


def _copy(follower: Follower, logger: Logger, warn: Callable[[str], None]) -> None:
    for change in follower.look():
        if isinstance(change, str):
            warn(change)
            continue
        run = change.record.id
        if change.is_new:
            logger.start(run, change.record.settings)
        logger.log(run, points(change))
        if change.record.status == "finished":
            logger.end(run)
