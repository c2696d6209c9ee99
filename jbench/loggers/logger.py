"""Copying committed rows to the logs of an experiment tracker, whose library is imported then."""

import contextlib
import hashlib
import json
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from jbench.closing import called_on_error, closed_on_error
from jbench.errors import ERRORS_OF_OTHERS, RequestError, sentence_of_failure
from jbench.store import Results
from jbench.store.follow import POLL_SECONDS, Change, Follower, grouped
from jbench.store.schema import LOSSES

_PROJECT = "jbench"
_Values = dict[str, float]  # by name, such as training/episode_return


class Logger(ABC):
    """The logs of runs in a tracker; `where` is a sentence on where they can be seen."""

    where: str

    def __init__(self) -> None:
        """Begins no log yet."""
        self._logs: dict[str, Any] = {}  # objects of the tracker's library, by run

    def copy(self, change: Change) -> None:
        """Adds new rows of a run to its log; one that starts replaces its earlier log."""
        record = change.record
        run = change.record.id
        if change.is_new:
            self.end(run)
            self._logs[run] = self._begin(run, run.rpartition("/")[0], dict(record.settings))

        for steps, time, values in _points(change):
            self._add(self._logs[run], steps, time, values)

        if record.is_finished:
            self.end(run)

    def end(self, run: str) -> None:
        """Ends the log of a run, if it was started, and waits until its points are written."""
        if run in self._logs:
            self._finish(self._logs.pop(run))

    @abstractmethod
    def _begin(self, name: str, group: str, config: dict[str, Any]) -> Any:
        """Starts and returns the log of a run, which the tracker shows in a group.

        A log that can't be started is left closed.
        """

    @abstractmethod
    def _add(self, log: Any, steps: int, time: float, values: _Values) -> None:
        """Adds values at a control step to the log of a run; `time` in s since the epoch."""

    def _finish(self, log: Any) -> None:
        """Ends the log of a run."""
        log.finish()


class _TensorBoard(Logger):
    """Writes event files to the directory of a run's id below `directory`."""

    def __init__(self, directory: Path) -> None:
        """Imports the library, which is optional."""
        from torch.utils.tensorboard import SummaryWriter

        super().__init__()
        self._make_writer = SummaryWriter
        self._directory = directory
        self.where = f"tensorboard --logdir {directory} shows the log."

    def _begin(self, name: str, group: str, config: dict[str, Any]) -> Any:
        """Begins a file of events; points of earlier ones are hidden."""
        # The new file hides the points of earlier files from step 0 on.
        place = str(self._directory / name)
        writer = self._make_writer(place, purge_step=0, flush_secs=int(POLL_SECONDS))
        with closed_on_error(writer):
            writer.add_text("settings", f"    {json.dumps(config, indent=4)}")
        return writer

    def _add(self, log: Any, steps: int, time: float, values: _Values) -> None:
        """Adds a point to each curve."""
        for name, value in values.items():
            log.add_scalar(name, value, steps, time)

    def _finish(self, log: Any) -> None:
        """Closes the file."""
        log.close()


class _Trackio(Logger):
    """Writes to `directory`, unless TRACKIO_DIR names another one."""

    def __init__(self, directory: Path) -> None:
        """Imports the library, which reads its directory from the environment."""
        # It is read when the library is imported.
        where = os.environ.setdefault("TRACKIO_DIR", str(directory.absolute()))
        import trackio

        super().__init__()
        self._library: Any = trackio
        self.where = f"TRACKIO_DIR={where} trackio show --project {_PROJECT} shows the log."

    def _begin(self, name: str, group: str, config: dict[str, Any]) -> Any:
        """Begins a log in place of an earlier one of the run."""
        with contextlib.suppress(ValueError):  # there is no project yet
            for earlier in self._library.Api().runs(_PROJECT):
                if earlier.name == name:
                    earlier.delete()
        off = dict.fromkeys(("embed", "auto_log_gpu", "auto_log_cpu"), False)
        return self._library.init(project=_PROJECT, name=name, group=group, config=config, **off)

    def _add(self, log: Any, steps: int, time: float, values: _Values) -> None:
        """Adds a point to each curve."""
        log.log(values, step=steps)


class _WeightsAndBiases(Logger):
    """Keeps the local files of W&B in `directory`, which must be called wandb."""

    def __init__(self, directory: Path) -> None:
        """Imports the library, whose own variables choose the account and the project."""
        import wandb

        super().__init__()
        directory.mkdir(parents=True, exist_ok=True)
        self._library: Any = wandb
        project = os.environ.get("WANDB_PROJECT", _PROJECT)
        # W&B adds the directory wandb.
        self._arguments: dict[str, Any] = {
            "project": project,
            "dir": directory.parent,
            "reinit": "create_new",
        }
        self._arguments["settings"] = wandb.Settings(console="off")
        self.where = f"The log is the project {project} of Weights & Biases."

    def _begin(self, name: str, group: str, config: dict[str, Any]) -> Any:
        """Begins a log in place of an earlier one of the run."""
        # A run of the same id is overwritten.
        about = {"id": hashlib.sha256(name.encode()).hexdigest()[:16], "name": name}
        log = self._library.init(group=group, config=config, **about, **self._arguments)
        with called_on_error(log.finish):
            log.define_metric("*", step_metric="control_steps")
        return log

    def _add(self, log: Any, steps: int, time: float, values: _Values) -> None:
        """Adds a point to each curve, over control steps."""
        log.log({"control_steps": steps, **values})


_TRACKERS: dict[str, Callable[[Path], Logger]] = {
    "tensorboard": _TensorBoard,
    "trackio": _Trackio,
    "wandb": _WeightsAndBiases,
}


def make_logger(name: str, results: Path) -> Logger:
    """Returns the logger of a tracker (`names.LOGGERS`); its files are in the results directory.

    Raises a RequestError if its library is not installed or can't be used.
    """
    install = f"pip install 'jbench[{name}]'"
    try:
        return _TRACKERS[name](results / name)
    except ModuleNotFoundError as error:
        raise RequestError(
            f"--log {name} needs the package {error.name or name}; type {install}."
        ) from None
    except ERRORS_OF_OTHERS as error:
        reason = sentence_of_failure(error)
        raise RequestError(
            f"--log {name} can't be used ({reason}); type {install}, or leave --log out."
        ) from None


def _points(change: Change) -> Iterator[tuple[int, float, _Values]]:
    """Yields the values of each episode, evaluation and logged step; unknown ones are left out.

    Before them come the control steps of the run, and the time in s since the epoch: that of the
    run's creation plus the wall time of its training, so the time between the processes of a
    resumed run is left out.
    """
    created = datetime.fromisoformat(change.record.manifest.created).timestamp()
    for table, rows in grouped(change.rows):
        first = rows[0]
        values = dict[str, float | None]()
        if table == "metrics":
            values = {f"metrics/{row['name']}": row["value"] for row in rows}
        elif table == "episodes":
            values = {"training/episode_return": first["episode_return"]}
            for name in LOSSES:
                values[f"losses/{name}"] = first[name]
        else:
            returns = [row["episode_return"] for row in rows]
            if None not in returns:
                values["evaluation/mean_return"] = sum(returns) / len(returns)

        known = {name: value for name, value in values.items() if value is not None}
        yield first["control_steps"], created + (first["wall_time"] or 0.0), known


@contextlib.contextmanager
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
        is_last = False
        try:
            while not is_last:
                is_last = done.wait(POLL_SECONDS)
                for change in follower.changes():
                    if isinstance(change, str):
                        warn(change)
                    else:
                        logger.copy(change)

            for run in runs:
                logger.end(run)
        except ERRORS_OF_OTHERS as error:
            reason = sentence_of_failure(error)
            warn(f"Logging has stopped ({reason}); the training is not affected.")
            # An experiment tracker shows a run as running until its log is ended.
            for run in runs:
                with contextlib.suppress(*ERRORS_OF_OTHERS):
                    logger.end(run)

    thread = threading.Thread(target=copy_until_done, daemon=True)
    thread.start()

    try:
        yield
    finally:
        done.set()
        thread.join()
