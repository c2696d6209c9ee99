"""Scores of each seed of a configuration."""

from typing import NamedTuple

import numpy as np

from jbench.array_types import BoolArray, FloatArray
from jbench.statistics.agents import Agents


class Scores(NamedTuple):
    """Scores (seeds,) of a configuration up to a control step.

    deviations are those of the episodes, in number `episodes`, that a final return averages; NaN if
    unknown. known (seeds of the configuration,) says which seeds have scores.
    """

    final: FloatArray
    area: FloatArray  # mean return over the run
    deviations: FloatArray
    episodes: FloatArray
    known: BoolArray
    middle: float  # control step of the final returns, a median

    @property
    def deviation_by_episodes(self) -> float:
        """Standard deviation of the final returns if all agents had the same expected return."""
        return float(np.sqrt(self.agents.episode_variance)) if len(self.final) else np.nan

    @property
    def agents(self) -> Agents:
        """The final returns with the variances that are due to their episodes."""
        return Agents(self.final, self.deviations**2 / self.episodes, self.episodes)
