"""The paper's learning curves, and imported ones that are drawn like them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import EPISODE_STEPS, FULL
from jbench.report.data.cells import IMPORTED, Cell
from jbench.report.data.curves import BAND_SEEDS, QUANTILES, Curve, FloatArray, final_returns
from jbench.report.data.returns import TRAINING

PUBLISHED = "published"
"""Source of the paper's curves."""

PPO_ENVIRONMENTS = 8
"""Parallel environments of the paper's PPO; its figures probably count the steps of only one."""

SEEDS = 10
"""Number of seeds in the paper's Figures 8 and 9; Figure 7 shows one."""

SEQUENCE_ROBOTS = 10
"""Number of augmented robots in the authors' SAC sequence, with 1e6 control steps each."""

_SEQUENCE = "augmented-sac"

# The sequence of robots, and Figure 8 with a wider, estimated band.
_NOT_COMPARED = (_SEQUENCE, "fig8-10-90")


@dataclass(frozen=True)
class PublishedCurve:
    """One learning curve of the paper, or an imported one.

    Attributes:
        figure: figure of the paper (`fig7`, `fig8` or `fig9`), `augmented-sac`, or `IMPORTED`.
        representation: `full` or `dae12`.
        control_steps: (points,) center of the window, as printed.
        quantiles: (points,) episode returns by percent; always contains 50.
    """

    figure: str
    task: str
    algo: str
    representation: str
    control_steps: FloatArray
    quantiles: dict[int, FloatArray]

    @property
    def sequence(self) -> bool:
        """Whether training goes through several augmented robots."""
        return self.figure == _SEQUENCE

    @property
    def figure_name(self) -> str:
        """Name of the figure in the paper, such as `Figure 9`."""
        return name_of_figure(self.figure)

    @property
    def source(self) -> str:
        """`PUBLISHED` or `IMPORTED`."""
        return IMPORTED if self.figure == IMPORTED else PUBLISHED

    @property
    def seeds(self) -> int:
        """Number of seeds of a curve of the paper."""
        return 1 if self.figure == "fig7" else SEEDS

    def median_at(self, control_steps: float) -> float | None:
        """Returns the interpolated median at a control step; None if the curve does not reach it.

        The curve's ends have a tolerance of an episode, because the paper's windows are counted
        from the start of an episode and ours from its end.
        """
        low, high = self.control_steps[0] - EPISODE_STEPS, self.control_steps[-1] + EPISODE_STEPS
        if not low <= control_steps <= high:
            return None
        return float(np.interp(control_steps, self.control_steps, self.quantiles[50]))


def name_of_figure(figure: str) -> str:
    """Returns the name of a figure by its id: `Figure 9`, or `augmented SAC`."""
    return figure.replace("fig", "Figure ").replace(_SEQUENCE, "augmented SAC")


def imported_curve(cell: Cell, curve: Curve) -> PublishedCurve:
    """Returns an imported curve in the form of a published one."""
    known = curve.seeds > 0
    percents = QUANTILES if len(cell.seeds) >= BAND_SEEDS else (50,)
    return PublishedCurve(
        figure=IMPORTED,
        task=cell.task,
        algo=cell.algo,
        representation=cell.representation,
        control_steps=curve.control_steps[known],
        quantiles={percent: curve.quantile(percent)[known] for percent in percents},
    )


def read_published(table: pa.Table) -> list[PublishedCurve]:
    """Returns the curves of Figures 7, 8 and 9 from the table `published`."""
    frame: pd.DataFrame = table.to_pandas(use_threads=False)
    return _curves(frame[~frame["figure"].isin(_NOT_COMPARED)])


def read_sequences(table: pa.Table) -> list[PublishedCurve]:
    """Returns the curve of SAC on ten augmented robots in sequence, from the table `published`.

    Its moving average is over 20 episodes, within each robot.
    """
    frame: pd.DataFrame = table.to_pandas(use_threads=False)
    curves = _curves(frame[frame["figure"] == _SEQUENCE])
    return [replace(curve, representation=FULL) for curve in curves]


def _curves(frame: pd.DataFrame) -> list[PublishedCurve]:
    curves = []
    for (figure, task, algo, representation), rows in frame.groupby(
        ["figure", "task", "algo", "representation"]
    ):
        # pandas' pivot takes four times as long.
        steps, column = np.unique(rows["control_steps"].to_numpy(np.float64), return_inverse=True)
        percents, row = np.unique(rows["quantile"].to_numpy(), return_inverse=True)
        returns = np.full((len(percents), len(steps)), np.nan)
        returns[row, column] = rows["episode_return"].to_numpy(np.float64)
        known = np.isfinite(returns).all(axis=0)
        curves.append(
            PublishedCurve(
                figure=str(figure),
                task=str(task),
                algo=str(algo),
                representation=str(representation),
                control_steps=steps[known],
                quantiles={int(q): one[known] for q, one in zip(percents, returns, strict=True)},
            )
        )
    return curves


def best_median(
    curves: Iterable[PublishedCurve],
    task: str,
    algo: str,
    representation: str,
    control_steps: float,
    *,
    sequence: bool = False,
) -> tuple[float, str] | None:
    """Returns the best published median at a control step, and the figure's id.

    Args:
        control_steps: center of a window.
        sequence: whether to use the curve of several augmented robots, or of the plain robot.
    """
    medians = [
        (median, curve.figure)
        for curve in curves
        if (curve.task, curve.algo, curve.representation) == (task, algo, representation)
        and curve.sequence == sequence
        and (median := curve.median_at(control_steps)) is not None
    ]
    return max(medians, default=None)


def best_at_end(curves: Iterable[PublishedCurve], task: str) -> float | None:
    """Returns a task's best published median at the end of training on the plain robot."""
    medians = [float(c.quantiles[50][-1]) for c in curves if c.task == task and not c.sequence]
    return max(medians, default=None)


def best_beside(cell: Cell, curves: Iterable[PublishedCurve]) -> tuple[float, str] | None:
    """Returns the paper's best median at the end of a cell of training returns, and its figure."""
    if cell.kind is not TRAINING:
        return None
    names = cell.task, cell.algo, cell.representation
    _, middles = final_returns(
        cell.returns, cell.control_steps, cell.lengths, cell.kind.final_points
    )
    steps = float(np.median(middles))
    return best_median(curves, *names, steps, sequence=cell.robots > 1)
