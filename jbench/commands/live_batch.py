"""A row of the live table."""

import itertools
import time
from collections.abc import Sequence
from functools import cache
from statistics import fmean
from typing import TYPE_CHECKING

from jbench.names import EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.wording import duration

if TYPE_CHECKING:
    import pandas as pd

_MAX_RETURNS = 6  # with more seeds, a line shows the mean and extremes of their newest returns
_SPARKLINE = 16  # characters
_BARS = "▁▂▃▄▅▆▇█"


class ProcessRow:
    """The progress of runs that share a process."""

    def __init__(self, runs: Sequence[RunSettings]) -> None:
        self.runs = runs
        self.done = {run.id: 0 for run in runs}
        self._returns: dict[str, float] = {}
        self._curve: list[float] = []
        self._total = sum(run.last_step for run in runs)
        self._cells = len({(run.task, run.representation) for run in runs})
        self._first: tuple[float, int] | None = None

    @property
    def name(self) -> str:
        """The configuration and the seeds, or the number of configurations."""
        run, seeds = self.runs[0], ",".join(str(run.seed) for run in self.runs)
        if self._cells > 1:
            return f"{run.algo} {len(self.runs)} runs of {self._cells} configurations"
        return f"{run.task} {run.algo} {run.representation} seed {seeds}"

    @property
    def steps(self) -> int:
        """Control steps done, summed over the runs."""
        return sum(self.done.values())

    @property
    def gained(self) -> int:
        """Control steps since the first message."""
        return 0 if self._first is None else self.steps - self._first[1]

    def update(self, run: RunSettings, steps: int, resumed: bool = False) -> None:
        """Sets the control steps of a run; the speed is measured from the step of resumption."""
        self.done[run.id] = min(steps, run.last_step)
        if self._first is None or resumed:
            self._first = time.monotonic(), self.steps

    def add_return(self, run: RunSettings, episode_return: float) -> None:
        """Adds the return of an episode of a run."""
        self._returns[run.id] = episode_return
        self._curve.append(episode_return)

    def rate(self) -> float | None:
        """Returns the control steps per second of all runs; None if not known yet."""
        if self._first is None or not self.gained:
            return None
        return self.gained / (time.monotonic() - self._first[0])

    def cells(self) -> tuple[str, ...]:
        """Returns the cells of a row: name, steps, speed, curve, newest returns, time left."""
        rate = self.rate()
        return (
            self.name,
            f"{self.steps:,}/{self._total:,}",
            "" if rate is None else f"{rate:,.0f}",
            sparkline(self._curve),
            self._newest_returns(),
            "" if rate is None else duration((self._total - self.steps) / rate),
        )

    def _newest_returns(self) -> str:
        values = list(self._returns.values())
        if len(values) <= _MAX_RETURNS:
            text = " ".join(f"{value:.0f}" for value in values)
        else:
            text = f"mean {fmean(values):.0f} [{min(values):.0f}, {max(values):.0f}]"
        if self._cells > 1:
            return text
        published = published_median(self.runs[0], self.steps / len(self.runs))
        return text if published is None or not text else f"{text} (published {published:.0f})"


def sparkline(returns: Sequence[float]) -> str:
    """Returns means of consecutive episode returns as bars; a full bar is the highest return."""
    width = min(len(returns), _SPARKLINE)
    bounds = [len(returns) * i // width for i in range(width + 1)] if width else []
    means = [fmean(returns[first:last]) for first, last in itertools.pairwise(bounds)]
    levels = [round(mean / EPISODE_STEPS * (len(_BARS) - 1)) for mean in means]
    return "".join(_BARS[min(max(level, 0), len(_BARS) - 1)] for level in levels)


def published_median(run: RunSettings, control_steps: float) -> float | None:
    """Returns the paper's median return at a control step, if it has a curve like the run."""
    from jbench.report.data.published import best_median

    cell = run.task, run.algo, run.representation
    best = best_median(_published_curves(), *cell, control_steps)
    return None if best is None else best[0]


@cache
def _published_curves() -> "pd.DataFrame":
    from jbench.report.data.published import read_published
    from jbench.store import query

    return read_published(query.published())
