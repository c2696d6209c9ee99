"""Scores of each seed of a configuration, and their statistics across seeds."""

from collections.abc import Callable
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from jbench.report.data.configuration import IMPORTED, Configuration
from jbench.report.data.curves import Curve, final_returns, moving_average, steps_to_threshold
from jbench.report.data.returns import EVALUATION, FILE, FINAL_POINTS, SOLVED
from jbench.returns import final_episodes
from jbench.statistics import BoolArray, FloatArray, IntArray
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import Agents, components, difference, smallest_difference

IQM_DIFFERENCE = st.difference(st.interquartile_mean)

Pair = tuple[Configuration, Configuration]

Ends = Callable[[float], tuple[float, float]]
"""Gives the interval of a number at a confidence."""


class Scores(NamedTuple):
    """Scores of a configuration's seeds up to a control step.

    Attributes:
        final: (seeds,) final returns.
        area: (seeds,) mean return over the run.
        deviations: (seeds,) standard deviation of the episodes that a final return averages; NaN
            if unknown.
        episodes: (seeds,) their number.
        known: (seeds of the configuration,) whether a seed has scores.
        control_steps: maximum control steps of the scores.
    """

    final: FloatArray
    area: FloatArray
    deviations: FloatArray
    episodes: FloatArray
    known: BoolArray
    control_steps: int

    @property
    def deviation_by_episodes(self) -> float:
        """Standard deviation of the final returns if all agents had the same expected return."""
        return float(np.sqrt(self.agents.episode_variance)) if len(self.final) else np.nan

    @property
    def agents(self) -> Agents:
        """The final returns with the variances that are due to their episodes."""
        return Agents(self.final, self.deviations**2 / self.episodes, self.episodes)


_SCORES: WeakKeyDictionary[Configuration, dict[int | None, Scores]] = WeakKeyDictionary()
"""Scores of the existing configurations, which many frames need; a configuration never changes."""


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
    final, _ = final_returns(returns, configuration.control_steps, lengths, most)
    area = moving_average(returns, returns.shape[1])[:, 0]
    usable = np.isfinite(final) & np.isfinite(area)
    deviations, episodes = _episodes(configuration, returns, lengths)
    numbers = final[usable], area[usable], deviations[usable], episodes[usable]
    return known.setdefault(control_steps, Scores(*numbers, usable, int(end)))


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
    deviations = [
        np.std(values, ddof=1) if len(values) > 1 and are_episodes else np.nan for values in ends
    ]
    return np.array(deviations, float), np.array([len(values) for values in ends], float)


class Comparison:
    """Two configurations at the last control step that each of their seeds has reached.

    Attributes:
        ours: scores of the first one, up to `control_steps`.
        theirs: scores of the second one.
        seeds: smaller number of seeds with scores.
        decidable: whether these are enough for a verdict.
    """

    def __init__(self, ours: Configuration, theirs: Configuration) -> None:
        self.control_steps = int(min(ours.last_step, theirs.last_step))
        self.ours, self.theirs = (seed_scores(one, self.control_steps) for one in (ours, theirs))
        self.seeds = min(len(self.ours.final), len(self.theirs.final))
        self.decidable = self.seeds >= st.DECIDING_SEEDS

    def sample(self, statistic: st.Statistic, scores: str = "final") -> st.Resampled:
        """Returns a statistic of the scores of both: `final`, or `area`."""
        groups = ([getattr(one, scores)] for one in (self.ours, self.theirs))
        return st.samples([statistic], *groups)[0]

    def agents_difference(self, confidence: float = 0.95) -> st.Estimate:
        """Returns the difference of the standard deviations between agents."""
        return difference(self.ours.agents, self.theirs.agents, confidence)


def ends(sample: st.Resampled) -> Ends:
    """Returns the intervals of a statistic."""
    return lambda confidence: sample.estimate(confidence)[1:3]


def statistics(configuration: Configuration, curve: Curve) -> dict[str, float]:
    """Returns the statistics of a configuration's seeds, with the ends of their 95% intervals.

    Columns: median, iqm (interquartile mean) and deviation (standard deviation) of the final
    returns, over_run (interquartile mean of the mean return over the run), solved_steps (median of
    the control steps to a return of `SOLVED`; infinite: after the runs' end; NaN for a sequence of
    robots), s (standard deviation between agents), each with …_low and …_high;
    deviation_by_episodes, detectable (smallest difference of means that two such configurations
    show; unknown for two seeds, as s is), and reached (number of seeds that reach `SOLVED`).
    """
    scores = seed_scores(configuration)
    location = {"median": st.median, "iqm": st.interquartile_mean}
    variability = {"deviation": st.standard_deviation} if len(scores.final) > 1 else {}
    row = _intervals(location | variability, scores.final)
    row |= _intervals({"over_run": st.interquartile_mean}, scores.area)
    row["deviation_by_episodes"] = scores.deviation_by_episodes
    if scores.agents.known and len(scores.final) >= st.MIN_SEEDS:
        s, low, high, w = components(scores.agents)
        detectable = smallest_difference(len(scores.final), s, w, scores.episodes.mean())
        row |= {"s": s, "s_low": low, "s_high": high, "detectable": detectable}
    if configuration.robots <= 1 and configuration.has_solved_return:
        steps = _steps_to_solved(configuration, curve)
        row |= _intervals({"solved_steps": st.median}, steps)
        row["reached"] = int(np.isfinite(steps).sum())
    return row


def _intervals(statistics: dict[str, st.Statistic], scores: FloatArray) -> dict[str, float]:
    row: dict[str, float] = {}
    for name, sample in zip(
        statistics, st.samples(list(statistics.values()), [scores]), strict=True
    ):
        row |= zip((name, f"{name}_low", f"{name}_high"), sample.estimate(), strict=False)
    return row


def _steps_to_solved(configuration: Configuration, curve: Curve) -> FloatArray:
    """Returns the control steps (seeds with a return,) after which each first reaches `SOLVED`.

    Windows that are cut off at the ends of a run do not count.
    """
    known = np.isfinite(configuration.returns).any(axis=1)
    at = moving_average(configuration.control_steps[known], curve.window)
    return steps_to_threshold(curve.each[known][:, curve.widths == curve.window], at, SOLVED)
