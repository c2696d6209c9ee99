"""The paper's learning curves, beside which ours are drawn and tabled."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import EPISODE_STEPS, FULL
from jbench.report.data.curves import FloatArray

PPO_ENVIRONMENTS = 8
"""Environments of the paper's PPO; its figures probably count the steps of one of them."""

SEQUENCE_ROBOTS = 10
"""Augmented robots that the authors' SAC learned on in turn, 1e6 control steps on each."""

_SEQUENCE = "augmented-sac"

# That sequence of robots, and Figure 8 once more with a wider, estimated band.
_NOT_COMPARED = (_SEQUENCE, "fig8-10-90")


@dataclass(frozen=True)
class PublishedCurve:
    """One learning curve of the paper.

    Attributes:
        figure: of the paper: `fig7`, `fig8` or `fig9`; else `augmented-sac`.
        task: what was learned.
        algo: by which algorithm.
        representation: `full` or `dae12`.
        control_steps: (points,) centre of the window, as printed.
        quantiles: (points,) episode returns, by percent; 50 is always there.
        sequence: whether it goes through several augmented robots.
    """

    figure: str
    task: str
    algo: str
    representation: str
    control_steps: FloatArray
    quantiles: dict[int, FloatArray]
    sequence: bool = False

    @property
    def figure_name(self) -> str:
        """Names the figure as the paper does: `Figure 9`."""
        return self.figure.replace("fig", "Figure ").replace(_SEQUENCE, "augmented SAC")

    def median_at(self, control_steps: float) -> float | None:
        """Returns the median there, interpolated; None where the curve does not reach.

        The ends are taken to within an episode: the paper's windows are counted from the start of
        an episode, ours from its end.
        """
        low, high = self.control_steps[0] - EPISODE_STEPS, self.control_steps[-1] + EPISODE_STEPS
        if not low <= control_steps <= high:
            return None
        return float(np.interp(control_steps, self.control_steps, self.quantiles[50]))


def read_published(table: pa.Table) -> list[PublishedCurve]:
    """Returns the curves of Figures 7, 8 and 9 from the table `published`."""
    frame: pd.DataFrame = table.to_pandas(use_threads=False)
    return _curves(frame[~frame["figure"].isin(_NOT_COMPARED)])


def read_sequences(table: pa.Table) -> list[PublishedCurve]:
    """Returns the curve of SAC on ten augmented robots in turn, from the table `published`.

    Its moving average is over 20 episodes, and of one robot's at a time.
    """
    frame: pd.DataFrame = table.to_pandas(use_threads=False)
    curves = _curves(frame[frame["figure"] == _SEQUENCE])
    return [replace(curve, representation=FULL, sequence=True) for curve in curves]


def _curves(frame: pd.DataFrame) -> list[PublishedCurve]:
    curves = []
    for (figure, task, algo, representation), rows in frame.groupby(
        ["figure", "task", "algo", "representation"]
    ):
        wide = rows.pivot_table("episode_return", "training_steps", "quantile").dropna()
        curves.append(
            PublishedCurve(
                figure=str(figure),
                task=str(task),
                algo=str(algo),
                representation=str(representation),
                control_steps=wide.index.to_numpy(np.float64),
                quantiles={int(str(q)): wide[q].to_numpy(np.float64) for q in wide},
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
    """Returns the best published median after so many control steps, and the figure's id.

    Args:
        curves: of the paper.
        task: what was learned.
        algo: by which algorithm.
        representation: `full` or `dae12`.
        control_steps: centre of a window.
        sequence: whether on several augmented robots in turn, or on the plain one.
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
    """Returns the best published median of a task at the end of training, on the plain robot."""
    medians = [float(c.quantiles[50][-1]) for c in curves if c.task == task and not c.sequence]
    return max(medians, default=None)
