"""Experiment trackers; their libraries are imported when one is used."""

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

_PROJECT = "jbench"


class Point(NamedTuple):
    """Values at a control step."""

    control_steps: int  # of the run, over all environments
    time: float  # seconds since the epoch
    values: Mapping[str, float]  # by name, such as training/episode_return


class TensorBoard:
    """Writes event files of TensorBoard."""

    def __init__(self, directory: Path) -> None:
        """Writes the event files of a run to the directory of its id below `directory`."""
        from torch.utils.tensorboard import SummaryWriter

        self._make_writer, self._directory = SummaryWriter, directory
        self._writers: dict[str, SummaryWriter] = {}
        self.where = f"tensorboard --logdir {directory} shows the log."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Opens a new event file, which hides the points of earlier files from step 0 on."""
        self.end(run)
        writer = self._make_writer(str(self._directory / run), purge_step=0)
        writer.add_text("settings", f"    {json.dumps(settings, indent=4)}")
        self._writers[run] = writer

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds the values of the points as scalars, and flushes the file."""
        writer = self._writers[run]
        for point in points:
            for name, value in point.values.items():
                writer.add_scalar(name, value, point.control_steps, point.time)
        writer.flush()

    def end(self, run: str) -> None:
        """Closes the event file, if it is open."""
        if run in self._writers:
            self._writers.pop(run).close()


class _Library:
    """Writes runs by a library with the interface of W&B."""

    def __init__(self, library: Any) -> None:
        self._library, self._runs = library, dict[str, Any]()

    def _begin(self, run: str, settings: Mapping[str, Any], **arguments: Any) -> None:
        group, config = run.rpartition("/")[0], dict(settings)
        # What a library prints must not mix with a JSON document.
        with contextlib.redirect_stdout(sys.stderr):
            self._runs[run] = self._library.init(name=run, group=group, config=config, **arguments)

    def end(self, run: str) -> None:
        """Ends the run, if it was started, and waits until its values are written."""
        if run in self._runs:
            with contextlib.redirect_stdout(sys.stderr):
                self._runs.pop(run).finish()


class Trackio(_Library):
    """Writes runs of trackio, a local tracker with the interface of W&B."""

    def __init__(self, directory: Path) -> None:
        """Writes to `directory`, unless TRACKIO_DIR names another one."""
        # It is read when the library is imported.
        where = os.environ.setdefault("TRACKIO_DIR", str(directory.absolute()))
        import trackio

        super().__init__(trackio)
        self.where = f"TRACKIO_DIR={where} trackio show --project {_PROJECT} shows the log."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Starts a trackio run, and deletes earlier ones of the same name."""
        self.end(run)
        with contextlib.suppress(ValueError):  # there is no project yet
            for earlier in self._library.Api().runs(_PROJECT):
                if earlier.name == run:
                    earlier.delete()
        off = dict.fromkeys(("embed", "auto_log_gpu", "auto_log_cpu"), False)
        self._begin(run, settings, project=_PROJECT, **off)

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds the values of the points."""
        for point in points:
            self._runs[run].log(dict(point.values), step=point.control_steps)


class WeightsAndBiases(_Library):
    """Writes runs of Weights & Biases."""

    def __init__(self, directory: Path) -> None:
        """Keeps the local files of W&B in `directory`, which must be called wandb."""
        import wandb

        super().__init__(wandb)
        directory.mkdir(parents=True, exist_ok=True)
        project = os.environ.get("WANDB_PROJECT", _PROJECT)
        settings = wandb.Settings(console="off")
        # W&B adds the directory wandb.
        self._arguments = {"project": project, "dir": directory.parent, "settings": settings}
        self.where = f"The log is the project {project} of Weights & Biases."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Starts a W&B run; one of the same id is overwritten."""
        self.end(run)
        id = hashlib.sha256(run.encode()).hexdigest()[:16]
        self._begin(run, settings, id=id, reinit="create_new", **self._arguments)
        self._runs[run].define_metric("*", step_metric="control_steps")

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds the values of the points."""
        for point in points:
            self._runs[run].log({"control_steps": point.control_steps, **point.values})
