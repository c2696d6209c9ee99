"""The divergence of an agent: what is not finite, and after how many steps."""

import math
from collections.abc import Mapping
from typing import Any, Self

from jbench.errors import WorkError


class DivergedError(WorkError):
    """The first sign that an agent diverged; its run fails, and its episodes until then are kept.

    `summary` is that in the manifest of the run.
    """

    def __init__(self, update: int | None, control_steps: int, what: str) -> None:
        """Names what is not finite: actions, weights, episode_return, or a loss.

        Args:
            update: number of updates made (PPO: epochs); None if unknown.
            control_steps: number of control steps made, over all environments.
        """
        self.what = what
        values = {"update": update, "control_steps": control_steps, "what": what}
        self.summary = {"diverged": values}
        verb = "are" if what in ("actions", "weights") else "is"
        after = "" if update is None else f" after update {update:,},"
        super().__init__(
            f"The agent diverged: its {what} {verb} not finite{after} at control step "
            f"{control_steps:,}."
        )

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Pickles it, for a training loop of others in a pool of processes."""
        return type(self), tuple(self.summary["diverged"].values())


def divergent_loss(losses: Mapping[str, float]) -> str | None:
    """Returns the name of the first updated loss that is not finite, or None.

    Features are updated before the critic and the critic before the actor, so a later loss is often
    not finite because of an earlier one.
    """
    divergent = [name for name, loss in losses.items() if not math.isfinite(loss)]
    for name in ("prediction_loss", "critic_loss", *divergent):
        if name in divergent:
            return name
    return None
