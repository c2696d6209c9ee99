"""The two kinds of return that a run records, of training episodes and of evaluations; their texts.

A cell has one kind. Cells, curves and statistics use the same code for both kinds; the kind only
determines the smoothing, the number of final points, and the names.
"""

import math
from dataclasses import dataclass

from jbench.names import ReturnsName
from jbench.returns import FINAL_EPISODES

SOLVED = 900
"""Episode return from which a task counts as solved (paper, Figure 9)."""


@dataclass(frozen=True)
class Returns:
    """A kind of return.

    Attributes:
        name: name in files and options.
        long: name in captions and sentences.
        axis: name on an axis, in two lines.
        final: definition of a seed's final return.
        up_to: definition of the final return up to a control step within a run.
        over_run: definition of a seed's return over its whole run.
        final_points: maximum number of points that are averaged in a final return.
        smoothed: whether a curve is a moving average; an evaluation is already a mean of episodes.
    """

    name: ReturnsName
    long: str
    axis: str
    final: str
    up_to: str
    over_run: str
    final_points: int
    smoothed: bool

    @property
    def plural(self) -> str:
        """Plural, such as `evaluation returns`."""
        return f"{self.name} returns"


TRAINING = Returns(
    name="training",
    long="training return, exploration included",
    axis="training return\n(exploration included)",
    final="A final training return is the mean over a run's last 100 training episodes, or over "
    "its last quarter if that is shorter; actions include exploration.",
    up_to="the mean of the last 100 training episodes up to that step, or of their last quarter",
    over_run="the mean over all training episodes of a run",
    final_points=FINAL_EPISODES,
    smoothed=True,
)
EVALUATION = Returns(
    name="evaluation",
    long="evaluation return of the deterministic policy",
    axis="evaluation return\n(deterministic policy)",
    final="A final evaluation return is the mean over the episodes of a run's last evaluation, in "
    "which the policy is deterministic.",
    up_to="the mean of the last evaluation up to that step",
    over_run="the mean over all evaluations of a run",
    final_points=1,
    smoothed=False,
)
KINDS: dict[ReturnsName, Returns] = {kind.name: kind for kind in (EVALUATION, TRAINING)}
"""Both kinds by name, evaluations first."""


def whole(value: float) -> str:
    """Formats a return; one just below `SOLVED` has a decimal: 899.6 must not read 900."""
    if SOLVED - 0.5 <= value < SOLVED:
        return f"{math.floor(10 * value) / 10:,}"
    return f"{round(value):,d}" if math.isfinite(value) else "infinite"


def signed(value: float) -> str:
    """Formats a difference of returns."""
    return f"{round(value):+,d}" if round(value) else "0"


def ratio(value: float) -> str:
    """Formats a ratio or a probability."""
    return f"{value:.2f}"


def steps(value: float) -> str:
    """Formats control steps in the unit that fits: `500`, `22.5k`, `300k`, `1M`."""
    if math.isinf(value):
        return "not reached"
    # Rounded first, so that 999,900 becomes 1M instead of 1e+03k.
    rounded = float(f"{value:.3g}")
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if rounded >= size:
            return f"{rounded / size:g}{unit}"
    return f"{rounded:g}"
