"""Runs of trackio, a local tracker with the interface of W&B."""

import contextlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jbench.loggers.logger import Point

_PROJECT = "jbench"


class Trackio:
    """Writes scalars over control steps, in one trackio run for each run."""

    def __init__(self, directory: Path) -> None:
        """Writes to `directory`, unless TRACKIO_DIR names another one."""
        # It is read when the library is imported.
        where = os.environ.setdefault("TRACKIO_DIR", str(directory.absolute()))
        import trackio

        self._library, self._runs = trackio, dict[str, Any]()
        self.where = f"TRACKIO_DIR={where} trackio show --project {_PROJECT} shows the log."

    def start(self, run: str, settings: Mapping[str, Any]) -> None:
        """Starts a trackio run, and deletes earlier ones of the same name."""
        self.end(run)
        with contextlib.suppress(ValueError):  # there is no project yet
            for earlier in self._library.Api().runs(_PROJECT):
                if earlier.name == run:
                    earlier.delete()
        with _messages():
            self._runs[run] = self._library.init(
                project=_PROJECT,
                name=run,
                group="/".join(run.split("/")[:-1]),
                config=dict(settings),
                embed=False,
                auto_log_gpu=False,
                auto_log_cpu=False,
            )

    def log(self, run: str, points: Sequence[Point]) -> None:
        """Adds the values of the points."""
        for point in points:
            self._runs[run].log(dict(point.values), step=point.control_steps)

    def end(self, run: str) -> None:
        """Ends the trackio run, if it was started, and waits until its values are written."""
        if run in self._runs:
            with _messages():
                self._runs.pop(run).finish()


def _messages() -> contextlib.AbstractContextManager[Any]:
    """Returns a context in which what the library prints does not mix with a JSON document."""
    return contextlib.redirect_stdout(sys.stderr)
