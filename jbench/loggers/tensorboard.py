"""Event files of TensorBoard, a directory for each run."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from jbench.loggers.logger import Point


class TensorBoard:
    """Writes scalars over control steps."""

    def __init__(self, directory: Path) -> None:
        """Writes the event files of a run to the directory of its id below `directory`."""
        self._directory = directory
        self._writers: dict[str, SummaryWriter] = {}
        self.where = f"tensorboard --logdir {directory} shows the log."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Opens a new event file, which hides the points of earlier files from step 0 on."""
        self.end(run)
        writer = SummaryWriter(str(self._directory / run), purge_step=0)
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
