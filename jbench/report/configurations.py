"""Statistics of configurations and of their seeds: of final returns and of whole runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.report.analysis.all_tasks import on_all_tasks, ranges, strata, together
from jbench.report.analysis.findings import solved_verdict
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configuration, Curves
from jbench.report.data.curves import Curve, SeedCurve, best_median
from jbench.report.data.points import long_frame
from jbench.report.data.scores import Scores
from jbench.report.data.source_names import FILE
from jbench.returns import TRAINING
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import components, smallest_difference
from jbench.task_specs import SOLVED_RETURN

_IS_SOLVED = {"supported": "yes", "contradicted": "no", "undecided": "undecided"}

_ESTIMATES = ("median", "iqm", "over_run", "deviation", "solved_steps")
"""Columns with the ends of their intervals beside them."""

CONFIGURATIONS = [
    *ID,
    "variant",
    "seeds",
    "draws",
    "steps_min",
    "steps",
    "diverged",
    *(f"{name}{end}" for name in _ESTIMATES for end in ("", "_low", "_high")),
    "deviation_by_episodes",
    "s",
    "s_low",
    "s_high",
    "detectable",
    "reached",
    "solved",
    "published",
    "published_figure",
    "note",
]
SEEDS = [*ID, "seed", "run", "final", "over_run", "episodes", "episode_sd", "diverged"]

_UNKNOWN = st.Estimate(np.nan)


@dataclass(frozen=True)
class ConfigurationStatistics:
    """What the runs of a configuration reach, by one kind of return.

    Estimates have 95% intervals. Numbers that are not known of the configuration are NaN or None.

    Attributes:
        config: the configuration.
        seeds: number of seeds with a final return.
        median, iqm, deviation: median, interquartile mean and standard deviation of final returns.
        over_run: interquartile mean of the mean return over the run.
        solved_steps: median of the control steps to a return of `SOLVED_RETURN`; infinite: after
            the runs' end. It is unknown for a sequence of robots.
        deviation_by_episodes: standard deviation of final returns if all agents were equally good.
        agents: standard deviation between agents.
        detectable: smallest difference of means that two such configurations show.
        reached: number of seeds that reach `SOLVED_RETURN`.
        solved: whether the median is `SOLVED_RETURN` or more: yes, no or undecided.
        published: the paper's median at the same control step, and the name of its figure.
    """

    config: Configuration
    seeds: int
    median: st.Estimate
    iqm: st.Estimate
    deviation: st.Estimate
    over_run: st.Estimate
    solved_steps: st.Estimate
    deviation_by_episodes: float
    agents: st.Estimate
    detectable: float
    reached: int | None
    solved: str | None
    published: tuple[float, str] | None

    def row(self) -> dict[str, Any]:
        """Returns the columns of `configuration_frame`."""
        config = self.config
        published = self.published or (np.nan, None)
        return {
            **config.identity,
            "variant": config.variant,
            "seeds": self.seeds,
            "draws": config.draws,
            "steps_min": int(config.steps.min()),
            "steps": int(config.steps.max()),
            "diverged": int(config.diverged.sum()),
            **_columns("median", self.median),
            **_columns("iqm", self.iqm),
            **_columns("over_run", self.over_run),
            **_columns("deviation", self.deviation),
            **_columns("solved_steps", self.solved_steps),
            "deviation_by_episodes": self.deviation_by_episodes,
            **_columns("s", self.agents),
            "detectable": self.detectable,
            "reached": self.reached,
            "solved": self.solved,
            "published": published[0],
            "published_figure": published[1],
            "note": "; ".join(config.notes),
        }


def _columns(name: str, estimate: st.Estimate) -> dict[str, float]:
    """Returns an estimate and the ends of its interval by the names of columns."""
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def configuration_frame(curves: Curves, published: pd.DataFrame) -> pd.DataFrame:
    """Returns a row per configuration and kind of return, in the order of drawing.

    Columns: `ID`, variant (hash), draws (number of encoders), steps_min and steps (control steps of
    training), diverged (number of seeds), note, and the attributes of `ConfigurationStatistics`, of
    which `agents` is s. The ends of intervals are …_low and …_high.
    """
    rows = [_statistics(config, curve, published).row() for config, curve in curves]
    return pd.DataFrame(rows, columns=CONFIGURATIONS).astype({"reached": "Int64"})


def _statistics(
    config: Configuration, curve: Curve, published: pd.DataFrame
) -> ConfigurationStatistics:
    """Returns the statistics of a configuration; `published` are the paper's curves."""
    scores = seed_scores(config)
    seeds = len(scores.final)
    of_final_returns = [st.median, st.interquartile_mean, st.standard_deviation]
    samples = st.samples(of_final_returns, [scores.final])
    median, iqm, deviation = (sample.estimate() for sample in samples)
    agents, detectable = _between_agents(scores)

    solved_steps = _UNKNOWN
    reached = None
    if config.robots <= 1 and config.has_solved_return:
        steps = _solved_steps(curve.by_seed)
        solved_steps = st.estimate(st.median, [steps])
        reached = int(np.isfinite(steps).sum())

    solved = None
    if seeds and config.has_solved_return:
        solved = _IS_SOLVED[solved_verdict(median, seeds).verdict]

    best = None
    if config.returns_name == TRAINING:  # the paper has no other returns
        names = config.task, config.algo, config.representation
        best = best_median(published, names, scores.middle, sequence=config.robots > 1)

    return ConfigurationStatistics(
        config=config,
        seeds=seeds,
        median=median,
        iqm=iqm,
        deviation=deviation,
        over_run=st.estimate(st.interquartile_mean, [scores.area]),
        solved_steps=solved_steps,
        deviation_by_episodes=scores.deviation_by_episodes,
        agents=agents,
        detectable=detectable,
        reached=reached,
        solved=solved,
        published=best,
    )


def _between_agents(scores: Scores) -> tuple[st.Estimate, float]:
    """Returns the standard deviation between agents, and the smallest difference that they show."""
    seeds = len(scores.final)
    if not scores.agents.is_known or seeds < st.MIN_SEEDS:
        return _UNKNOWN, np.nan

    between, low, high, within = components(scores.agents)
    detectable = smallest_difference(seeds, between, within, scores.episodes.mean())
    return st.Estimate(between, low, high), detectable


def _solved_steps(curves: Sequence[SeedCurve]) -> FloatArray:
    """Returns the control step at which a whole window of each seed first has `SOLVED_RETURN`."""
    first = []
    for curve in curves:
        solved = (curve.values >= SOLVED_RETURN) & (curve.widths == curve.window)
        if len(curve.values):
            first.append(curve.control_steps[solved].min(initial=np.inf))
    return np.array(first)


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


def seed_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns a row per seed with a final return.

    over_run is the mean return over the run. A final return averages episodes with the standard
    deviation episode_sd; that of their mean is episode_sd / √episodes.
    """
    parts = []
    for config in configurations:
        scores = seed_scores(config)
        known = scores.known
        arrays = {
            "seed": config.seeds[known],
            "run": np.array(config.runs, object)[known],
            "diverged": config.diverged[known],
            "final": scores.final,
            "over_run": scores.area,
            "episodes": scores.episodes,
            "episode_sd": scores.deviations,
        }
        parts.append((config.identity, arrays))

    return long_frame(parts, SEEDS)
