"""Divergence of agents: actions, weights, returns or losses that are not finite."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from jbench.errors import WorkError


class Divergence(NamedTuple):
    """The first sign that an agent diverged."""

    update: int | None  # number of updates made (PPO: epochs); None if unknown
    control_steps: int  # number of control steps made, over all environments
    what: str  # what is not finite: "actions", "weights", "episode_return", or the name of a loss

    def __str__(self) -> str:
        verb = "are" if self.what in ("actions", "weights") else "is"
        after = "" if self.update is None else f" after update {self.update:,},"
        return (
            f"The agent diverged: its {self.what} {verb} not finite{after} "
            f"at control step {self.control_steps:,}."
        )

    def to_summary(self) -> dict[str, dict[str, int | str | None]]:
        """Returns the summary in the manifest of a diverged run."""
        return {"diverged": self._asdict()}


def divergent_loss(losses: Mapping[str, float]) -> str | None:
    """Returns the name of the first updated loss that is not finite, or None.

    Features are updated before the critic and the critic before the actor, so a later loss is often
    not finite because of an earlier one.
    """
    names = [name for name, loss in losses.items() if not math.isfinite(loss)]
    first = [name for name in ("prediction_loss", "critic_loss") if name in names]
    return next(iter((*first, *names)), None)


class DivergedError(WorkError):
    """An agent diverged; the run fails, and its episodes until then are kept."""

    def __init__(self, divergence: Divergence) -> None:
        super().__init__(str(divergence))
        self.divergence = divergence
