"""Scores of each seed of a configuration, up to a control step, alone and over several tasks.

Returns of tasks with different ranges are normalized before they are joined: 0 is the lowest and 1
the highest return of a task, over all its runs and points, or the bounds that a reader typed. Tasks
of dm_control share a range.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from jbench.array_types import FloatArray
from jbench.report.data.common_steps import means_over_run
from jbench.report.data.configuration import ID, Configuration, in_order
from jbench.report.data.curves import final_returns
from jbench.report.data.points import long_frame
from jbench.report.data.scores import Scores
from jbench.report.data.source_names import FILE, IMPORTED
from jbench.returns import EVALUATION
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import deviation_difference
from jbench.statistics.permutation import p_value
from jbench.statistics.verdicts import Evidence

IQM_DIFFERENCE = st.difference(st.interquartile_mean)
# Names of several tasks together, which share a range or do not.
ALL_TASKS = "all tasks"
NORMALIZED = "all tasks, normalized"
PROFILES = [*ID, "seeds", "final_return", "share", "low", "high"]

Range = tuple[float, float]  # lowest and highest return


def seed_scores(configuration: Configuration, control_steps: int | None = None) -> Scores:
    """Returns the scores up to a control step; None: over the whole runs.

    They are computed once, and kept by the configuration.
    """
    if control_steps not in configuration.scores:
        configuration.scores[control_steps] = _computed(configuration, control_steps)
    return configuration.scores[control_steps]


def _computed(configuration: Configuration, control_steps: int | None) -> Scores:
    """Returns what `seed_scores` keeps."""
    end = configuration.longest if control_steps is None else control_steps
    lengths = configuration.lengths_up_to(end)
    within = np.arange(configuration.returns.shape[1]) < lengths[:, None]
    returns = np.where(within, configuration.returns, np.nan)

    final, middles, deviations, episodes = final_returns(
        returns, configuration.control_steps, lengths, configuration.returns_name
    )
    if configuration.returns_name == EVALUATION:
        last = np.arange(len(lengths)), lengths - 1
        deviations = configuration.deviations[last]
        episodes = configuration.counts[last]
    elif configuration.source in (IMPORTED, FILE):  # whose points need not be episodes
        deviations = np.full(len(final), np.nan)

    # Also if there is no point after it, or the mean of the last points has some before it.
    has_diverged = configuration.diverged_at <= end
    if control_steps is None:
        has_diverged = configuration.diverged
    final = np.where(has_diverged, configuration.diverged_returns, final)
    deviations = np.where(has_diverged, 0.0, deviations)
    episodes = np.where(has_diverged, np.maximum(episodes, 1), episodes)

    area = _means_over_run(configuration, configuration.beside, end)
    usable = np.isfinite(final) & np.isfinite(area)
    return Scores(
        final=final[usable],
        area=area[usable],
        deviations=deviations[usable],
        episodes=episodes[usable],
        known=usable,
        middle=float(np.median(middles)),
    )


def _means_over_run(
    configuration: Configuration, beside: Sequence[Configuration], control_steps: float
) -> FloatArray:
    """Returns each seed's mean return (seeds,) up to a control step, however others were logged."""
    others = [other.points_up_to(control_steps) for other in beside]
    return means_over_run(configuration.points_up_to(control_steps), others)


class Pair:
    """Two configurations, with scores at the last control step that every seed has reached."""

    def __init__(
        self, ours: Configuration, theirs: Configuration, control_steps: int | None = None
    ) -> None:
        """Compares at a control step, None for the last that every seed of both has reached."""
        self.ours = ours
        self.theirs = theirs
        self.sides = (ours, theirs)
        last = int(min(ours.last_step, theirs.last_step))
        self.control_steps = last if control_steps is None else control_steps
        self.scores = [self._scores(ours, theirs), self._scores(theirs, ours)]
        self.seeds = min(len(side.final) for side in self.scores)

    def up_to(self, control_steps: int) -> "Pair":
        """Returns the pair with scores up to an earlier control step, or the same one."""
        return self if control_steps == self.control_steps else Pair(*self.sides, control_steps)

    def _scores(self, side: Configuration, other: Configuration) -> Scores:
        """Returns the scores of a side, whose means over the run compare with the other's."""
        scores = seed_scores(side, self.control_steps)
        area = _means_over_run(side, [other], self.control_steps)
        return scores._replace(area=area[scores.known])

    def sample(self, statistic: st.Statistic, scores: str = "final") -> st.Resampled:
        """Returns a statistic of the scores of both: `final`, or `area`."""
        groups = ([getattr(side, scores)] for side in self.scores)
        return st.samples([statistic], *groups)[0]

    def difference(self, scores: str = "final", margin: float = 0.0) -> Evidence:
        """Returns the evidence of a difference of interquartile means, tested by that of means.

        Args:
            scores: `final`, or `area`.
            margin: within which both are equal; 0 if they never are.
        """
        sample = self.sample(IQM_DIFFERENCE, scores)
        ours, theirs = (getattr(side, scores) for side in self.scores)

        @cache
        def p_of_shifted(shift: float) -> float:
            return p_value([ours + shift], [theirs])

        return Evidence(sample.estimate, p_of_shifted, self.seeds, margin)

    def variability(self) -> Evidence:
        """Returns the evidence of a difference of the standard deviations between agents.

        The test compares mean absolute deviations from the median of each configuration, which a
        failed seed moves less than a variance (M. B. Brown, A. B. Forsythe, *Robust tests for the
        equality of variances*, J. Am. Stat. Assoc. 69, 1974).
        """

        @cache
        def p_of_difference(_: float) -> float:
            ours, theirs = (np.abs(side.final - np.median(side.final)) for side in self.scores)
            return p_value([ours], [theirs])

        ours, theirs = (side.agents for side in self.scores)
        estimate = partial(deviation_difference, ours, theirs)
        return Evidence(estimate, p_of_difference, self.seeds)

    def improvement(self) -> Evidence:
        """Returns the evidence of the probability of improvement, tested by means of ranks."""

        @cache
        def p_of_difference(_: float) -> float:
            first, other = (side.final for side in self.scores)
            ranks = rankdata(np.concatenate([first, other]))
            ours, theirs = np.split(ranks, [len(first)])
            return p_value([ours], [theirs])

        sample = self.sample(st.probability_of_improvement)
        return Evidence(sample.estimate, p_of_difference, self.seeds, null_value=0.5)


def ranges(configurations: Iterable[Configuration]) -> dict[str, Range]:
    """Returns the range of each task's returns: `return_range` if known, else the recorded.

    It is (0, 0) if none of a task's returns is finite.
    """
    known: dict[str, Range] = {}
    unknown = set[str]()
    for config in configurations:
        possible = config.return_range
        if possible is None:
            recorded = config.returns[np.isfinite(config.returns)]
            if not len(recorded):
                unknown.add(config.task)
                continue
            possible = float(recorded.min()), float(recorded.max())

        lowest, highest = possible
        low, high = known.get(config.task, (lowest, highest))
        known[config.task] = (min(low, lowest), max(high, highest))

    return dict.fromkeys(unknown, (0.0, 0.0)) | known


def strata(finals: Sequence[FloatArray], tasks: Sequence[Range]) -> tuple[list[FloatArray], Range]:
    """Returns final returns (seeds,) that can be joined, and their range: normalized if needed."""
    if len({*tasks}) == 1:
        return [*finals], tasks[0]
    normalized = [
        (final - low) / ((high - low) or 1.0)
        for final, (low, high) in zip(finals, tasks, strict=True)
    ]
    return normalized, (0.0, 1.0)


def together(known: Mapping[str, Range]) -> str:
    """Returns what several tasks together are called."""
    return ALL_TASKS if len({*known.values()}) == 1 else NORMALIZED


def on_all_tasks(configurations: Iterable[Configuration]) -> list[list[Configuration]]:
    """Returns the configurations, by task, that were trained equally long on each of several."""
    groups: dict[tuple[str, int], dict[str, Configuration]] = {}
    known = [config for config in configurations if len(seed_scores(config).final)]
    for config in known:
        # A file has one curve of a method on a task, of any length.
        steps = 0 if config.source == FILE else int(config.steps.max())
        groups.setdefault((config.label, steps), {}).setdefault(config.task, config)

    tasks = in_order(config.task for config in known)
    whole = [group for group in groups.values() if len(group) == len(tasks) > 1]
    return [[group[task] for task in tasks] for group in whole]


def profile_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the share of runs above each return (Agarwal et al., 2021, section 4.2).

    The rows of `together` are of the configurations that were trained on each task; every task has
    the same weight. The ends are those of pointwise 95% intervals, for at least three seeds.
    Configurations are of one kind of return, in the order of tasks.
    """
    known = ranges(configurations)
    parts = []
    finals = {config: seed_scores(config).final for config in configurations}
    alone = [config for config, final in finals.items() if len(final)]
    groups = [[config] for config in alone] + on_all_tasks(configurations)
    for group in groups:
        first = group[0]
        several = len(group) > 1
        scores, ends = strata(
            [finals[each] for each in group], [known[each.task] for each in group]
        )
        if not several and first.source == FILE:
            every = np.concatenate([finals[each] for each in alone if each.task == first.task])
            width = (every.max() - every.min()) or 1
            ends = every.min() - 0.02 * width, every.max()
        else:  # beyond bounds that a reader typed
            every = np.concatenate(scores)
            ends = min(ends[0], every.min()), max(ends[1], every.max())

        thresholds = np.linspace(*ends, 201)
        low = high = np.full(len(thresholds), np.nan)
        if min(map(len, scores)) >= st.MIN_SEEDS:
            low, high = st.profile_interval(scores, thresholds)

        names = {**first.identity, "seeds": sum(map(len, scores))}
        if several:
            names["task"] = together(known)
        numbers = {
            "final_return": thresholds,
            "low": low,
            "high": high,
            "share": st.performance_profile(scores, thresholds),
        }
        parts.append((names, numbers))

    return long_frame(parts, PROFILES)


def with_file_means(frame: pd.DataFrame, configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Adds rows to `configuration_frame`: each method of a file on all tasks together.

    Their seeds are those of the task that has the fewest.
    """
    known = ranges(configurations)
    task = together(known)
    rows = []
    for group in on_all_tasks(config for config in configurations if config.source == FILE):
        finals = [seed_scores(config).final for config in group]
        scores, _ = strata(finals, [known[config.task] for config in group])
        estimate = st.estimate(st.interquartile_mean, scores)
        ends = [steps for config in group for steps in config.steps]
        row: dict[str, Any] = {
            **group[0].identity,
            "task": task,
            "configuration": f"{task} {group[0].label}",
            "seeds": min(map(len, scores)),
            "iqm": estimate.value,
            "iqm_low": estimate.low,
            "iqm_high": estimate.high,
            "draws": 0,
            "diverged": 0,
            "steps_min": min(ends),
            "steps": max(ends),
        }
        rows.append(row)

    if not rows:
        return frame

    more = pd.DataFrame(rows, columns=frame.columns).astype({"reached": "Int64"})
    return pd.concat([frame, more], ignore_index=True)
