"""The two kinds of return that a run records: of its training episodes and of its evaluations.

A cell is of one kind, and every function of cells, curves and statistics serves both: the kind
says only how they are smoothed, which of them are the end of a run, and what they are called.
"""

from dataclasses import dataclass

from jbench.names import ReturnsName
from jbench.returns import FINAL_EPISODES


@dataclass(frozen=True)
class Returns:
    """A kind of return.

    Attributes:
        name: what it is called in files and options.
        long: what it is called in a caption or a sentence.
        axis: what it is called on an axis, in two lines.
        final: how a seed's final return is defined.
        up_to: how it is defined up to a control step within a run.
        over_run: how a seed's return over its whole run is defined.
        final_points: points at the end of a run, at most, whose mean is its final return.
        smoothed: whether a curve is a moving average; an evaluation is a mean of episodes already.
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
        """Names several of them: `evaluation returns`."""
        return f"{self.name} returns"


TRAINING = Returns(
    name="training",
    long="training return, exploration included",
    axis="training return\n(exploration included)",
    final="A final training return is the mean of a run's last 100 training episodes, or of its "
    "last quarter where that is less; the actions are those of training, exploration included.",
    up_to="the mean of the last 100 training episodes up to there, or of their last quarter",
    over_run="the mean over all training episodes of a run",
    final_points=FINAL_EPISODES,
    smoothed=True,
)
EVALUATION = Returns(
    name="evaluation",
    long="evaluation return of the deterministic policy",
    axis="evaluation return\n(deterministic policy)",
    final="A final evaluation return is the mean of the episodes of a run's last evaluation, in "
    "which the policy is deterministic.",
    up_to="the mean of the last evaluation up to there",
    over_run="the mean over all evaluations of a run",
    final_points=1,
    smoothed=False,
)
KINDS: dict[ReturnsName, Returns] = {kind.name: kind for kind in (EVALUATION, TRAINING)}
"""Both kinds by name, that of evaluations first."""


def in_order_of(lead: ReturnsName) -> list[Returns]:
    """Returns both kinds, the leading one first."""
    return sorted(KINDS.values(), key=lambda kind: kind.name != lead)
