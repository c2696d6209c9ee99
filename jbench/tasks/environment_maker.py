"""The interface between an `EnvironmentTask` and its worlds, which import each other otherwise."""

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.tasks.task import Task


class EnvironmentMaker(Task):
    """A task that makes environments: what `EnvironmentWorlds` asks of an `EnvironmentTask`.

    Attributes:
        reseeds: whether an episode reseeds the same environment, instead of making a new one.
        has_unit_rewards: whether all rewards must be in [0, 1].
        limit_advice: what to add so that the time limit is known, if an episode was made to
            measure it, as a clause; None if the environment says its time limit.
    """

    reseeds: bool
    has_unit_rewards: bool
    limit_advice: str | None

    @abstractmethod
    def environment(self, seed: int, *, draws: bool = False) -> Any:
        """Returns a new environment, which may draw itself; RequestError if it can't be made."""

    @abstractmethod
    def reseed(self, environment: Any, seed: int) -> None:
        """Seeds the next episode of an environment."""

    @abstractmethod
    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to the actuators' bounds."""
