"""Scores of each seed of a configuration, up to a control step."""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from jbench.report.data.configuration import IMPORTED, Configuration
from jbench.report.data.curves import final_returns, moving_average
from jbench.report.data.returns import EVALUATION, FILE, FINAL_POINTS
from jbench.returns import final_episodes
from jbench.statistics import BoolArray, FloatArray, IntArray
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import Agents, difference

IQM_DIFFERENCE = st.difference(st.interquartile_mean)
Pair = tuple[Configuration, Configuration]


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


# Of the existing configurations, which many frames need; a configuration never changes.
_SCORES: WeakKeyDictionary[Configuration, dict[int | None, Scores]] = WeakKeyDictionary()


def seed_scores(configuration: Configuration, control_steps: int | None = None) -> Scores:
    """Returns the scores up to a control step; None: over the whole runs."""
    known = _SCORES.setdefault(configuration, {})
    if control_steps in known:
        return known[control_steps]
    end = configuration.longest if control_steps is None else control_steps
    lengths = configuration.lengths_up_to(end)
    within = np.arange(configuration.returns.shape[1]) < lengths[:, None]
    returns = np.where(within, configuration.returns, np.nan)
    most = FINAL_POINTS[configuration.kind]
    final, middles = final_returns(returns, configuration.control_steps, lengths, most)
    area = moving_average(returns, returns.shape[1])[:, 0]
    usable = np.isfinite(final) & np.isfinite(area)
    deviations, episodes = _episodes(configuration, returns, lengths)
    numbers = final[usable], area[usable], deviations[usable], episodes[usable]
    return known.setdefault(control_steps, Scores(*numbers, usable, float(np.median(middles))))


def _episodes(
    configuration: Configuration, returns: FloatArray, lengths: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Returns the standard deviation and the number (seeds,) of the episodes of final returns."""
    if configuration.kind == EVALUATION:
        last = np.arange(len(lengths)), lengths - 1
        return configuration.deviations[last], configuration.counts[last]
    counts = final_episodes(lengths, FINAL_POINTS[configuration.kind])
    ends = [row[end - n : end] for row, end, n in zip(returns, lengths, counts, strict=True)]
    ends = [values[np.isfinite(values)] for values in ends]
    # Points of imported curves need not be episodes.
    are_episodes = configuration.source not in (IMPORTED, FILE)
    deviations = [np.std(v, ddof=1) if len(v) > 1 and are_episodes else np.nan for v in ends]
    return np.array(deviations, float), np.array([len(values) for values in ends], float)


class PairedScores:
    """Scores of two configurations at the last control step that every seed has reached."""

    def __init__(self, ours: Configuration, theirs: Configuration) -> None:
        self.control_steps = int(min(ours.last_step, theirs.last_step))
        self.ours = seed_scores(ours, self.control_steps)
        self.theirs = seed_scores(theirs, self.control_steps)
        self.seeds = min(len(self.ours.final), len(self.theirs.final))
        self.decidable = self.seeds >= st.DECIDING_SEEDS  # enough for a verdict

    def sample(self, statistic: st.Statistic, scores: str = "final") -> st.Resampled:
        """Returns a statistic of the scores of both: `final`, or `area`."""
        groups = ([getattr(side, scores)] for side in (self.ours, self.theirs))
        return st.samples([statistic], *groups)[0]

    def agents_difference(self, confidence: float = 0.95) -> st.Estimate:
        """Returns the difference of the standard deviations between agents."""
        return difference(self.ours.agents, self.theirs.agents, confidence)
