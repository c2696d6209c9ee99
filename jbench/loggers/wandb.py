"""Runs of Weights & Biases."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import wandb

from jbench.loggers.logger import Point

_PROJECT = "jbench"  # unless WANDB_PROJECT names another one


class WeightsAndBiases:
    """Writes scalars over control steps, in one W&B run for each run."""

    def __init__(self, directory: Path) -> None:
        """Keeps the local files of W&B in `directory`, which must be called wandb."""
        directory.mkdir(parents=True, exist_ok=True)
        self._parent = directory.parent  # W&B adds the directory wandb
        self._project = os.environ.get("WANDB_PROJECT", _PROJECT)
        self._runs: dict[str, wandb.Run] = {}
        self.where = f"The log is the project {self._project} of Weights & Biases."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Starts a W&B run; one of the same id is overwritten."""
        self.end(run)
        started = wandb.init(
            project=self._project,
            dir=self._parent,
            id=hashlib.sha256(run.encode()).hexdigest()[:16],
            name=run,
            group="/".join(run.split("/")[:-1]),
            config=dict(settings),
            reinit="create_new",
            settings=wandb.Settings(console="off"),
        )
        started.define_metric("*", step_metric="control_steps")
        self._runs[run] = started

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds the values of the points."""
        for point in points:
            self._runs[run].log({"control_steps": point.control_steps, **point.values})

    def end(self, run: str) -> None:
        """Ends the W&B run and waits for its upload, if there is one."""
        if run in self._runs:
            self._runs.pop(run).finish()
