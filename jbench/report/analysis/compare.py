"""Comparisons of configurations: two sides, pairs, profiles."""

from collections.abc import Collection, Sequence
from statistics import multimode
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jbench.report.analysis.scores import compared_scores, seed_scores
from jbench.report.analysis.verdicts import Ends, corrected_level, difference_text, judged
from jbench.report.data.configuration import (
    ID,
    Configuration,
    differing_in,
    in_order,
    verified,
)
from jbench.report.data.returns import KINDS, signed
from jbench.settings.alike import comparable
from jbench.settings.variants import variant_labels
from jbench.statistics import bootstrap as st

PAIRS = [
    *("task", "returns", "a", "b", "a_label", "b_label", "p", "low", "high", "decided", "steps"),
]
PROFILES = [*ID, "returns", "seeds", "final_return", "share", "low", "high"]
COMPARISONS = [
    *("task", "algo", "representation", "words", "returns", "a", "b", "seeds_a", "seeds_b"),
    *("steps", "p", "p_low", "p_high", "difference", "low", "high"),
    *("median_difference", "median_low", "median_high", "corrected_low", "corrected_high", "text"),
]
ALL_TASKS = "all tasks"
THRESHOLDS = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is computed."""

_MAX_NAMED = 8


class Comparison(NamedTuple):
    """Final returns of two configurations, at the last control step that all seeds have reached.

    Attributes:
        control_steps: at which they are compared.
        seeds: numbers of seeds of ours and of theirs with a final return.
        improvement: probability that a run of ours ends above one of theirs.
        difference: difference of the interquartile means, ours minus theirs.
        medians: difference of the medians, ours minus theirs.
    """

    control_steps: int
    seeds: tuple[int, int]
    improvement: st.Sample
    difference: st.Sample
    medians: st.Sample


def compare(ours: Configuration, theirs: Configuration) -> Comparison:
    """Compares two configurations by the same kind of return."""
    one, other = compared_scores(ours, theirs)
    statistics = [
        st.probability_of_improvement,
        st.difference(st.interquartile_mean),
        st.difference(st.median),
    ]
    found = st.samples(statistics, [one.final], [other.final])
    return Comparison(one.control_steps, (len(one.final), len(other.final)), *found)


def comparison_frame(pairs: Sequence[tuple[Configuration, Configuration]]) -> pd.DataFrame:
    """Returns a row per comparison of two sides, the first minus the second, with 95% intervals.

    The verdict rests on an interval that is corrected for the number of comparisons by the same
    kind of return.
    """
    rows = []
    for kind in KINDS:
        found = [
            (ours, theirs, compare(ours, theirs)) for ours, theirs in pairs if ours.kind == kind
        ]
        enough = [min(one.seeds) >= st.DECIDING_SEEDS for *_, one in found]
        ends: list[Ends] = [_ends(one.difference) for *_, one in found]
        level = corrected_level([one for one, known in zip(ends, enough, strict=True) if known])
        for (ours, theirs, one), interval, known in zip(found, ends, enough, strict=True):
            low, high = interval(1 - level)
            row: dict[str, Any] = {name: ours.identity[name] for name in COMPARISONS[:4]}
            row |= {"returns": kind, "a": ours.source, "b": theirs.source}
            row |= {"seeds_a": one.seeds[0], "seeds_b": one.seeds[1], "steps": one.control_steps}
            numbers = [n for sample in one[2:] for n in sample.estimate()[:3]]
            row |= dict(zip(COMPARISONS[10:19], numbers, strict=True))
            verdict = judged(low, high) if known else "undecided"
            text = f"{verdict}: {difference_text(low, high)}"
            if np.isnan(low):
                text = f"{signed(one.difference.value)}, too few seeds"
            elif verdict in ("higher", "lower"):
                text = f"{ours.source} {difference_text(low, high)}"
            rows.append({**row, "corrected_low": low, "corrected_high": high, "text": text})
    return pd.DataFrame(rows, columns=COMPARISONS)


def _ends(sample: st.Sample) -> Ends:
    return lambda confidence: sample.estimate(confidence)[1:3]


def across(
    ours: Sequence[Configuration], theirs: Sequence[Configuration], names: Collection[str]
) -> list[tuple[Configuration, Configuration]]:
    """Returns the pairs of two sides that differ only in the settings of these names."""
    by_settings: dict[str, list[Configuration]] = {}
    for other in theirs:
        by_settings.setdefault(comparable(other.settings, *names), []).append(other)
    return [
        (one, other)
        for one in ours
        for other in by_settings.get(comparable(one.settings, *names), ())
        if one.kind == other.kind and (not names or one.settings != other.settings)
    ]


def left_out(
    ours: Sequence[Configuration],
    theirs: Sequence[Configuration],
    pairs: Sequence[tuple[Configuration, Configuration]],
) -> list[str]:
    """Returns sentences on the configurations of two sides without a comparison, and why."""
    paired = {id(one) for pair in pairs for one in pair}
    left = [[one for one in side if id(one) not in paired] for side in (ours, theirs)]
    notes = []
    for side in filter(None, left):
        names = [one.name for one in side]
        more = [f"and {len(names) - _MAX_NAMED} more"] if len(names) > _MAX_NAMED else []
        notes.append(f"Only in {side[0].source}: {'; '.join([*names[:_MAX_NAMED], *more])}.")
    for one in left[0]:
        named = [one.task, one.algo, one.representation]
        for other in (o for o in left[1] if [o.task, o.algo, o.representation] == named):
            reason = f"{one.source} and {other.source} have the same settings"
            if one.settings != other.settings:
                labels = variant_labels({"a": one.settings, "b": other.settings})
                mine, their = (labels[key].removesuffix(f" ({key})") for key in "ab")
                reason = f"{one.source} has {mine}; {other.source} has {their}"
            notes.append(f"{' '.join(named)} is not compared: {reason}.")
    return notes


def pair_frame(
    configurations: Sequence[Configuration], verdicts: pd.DataFrame | None = None
) -> pd.DataFrame:
    """Returns the probability that a run of configuration a ends above one of b, both ways.

    Only runs on the plain robot are paired, of at least `DECIDING_SEEDS` seeds each that were
    trained equally long. Columns: task, returns, a, b (configurations), their labels, p with
    its 95% interval (low, high), decided (as in the verdicts; for others,
    whether 0.5 is outside of the interval that is corrected for the number of pairs), steps (of
    training).

    Args:
        configurations: of one kind of return.
        verdicts: see `verdict_frame`; of the same kind of return.
    """
    known = [
        (one, scores)
        for one in verified(configurations)
        if not one.robots
        for scores in compared_scores(one)
        if len(scores.final) >= st.DECIDING_SEEDS
    ]
    found = [
        (one, other, st.samples([st.probability_of_improvement], [ours.final], [theirs.final])[0])
        for i, (one, ours) in enumerate(known)
        for other, theirs in known[i + 1 :]
        if one.task == other.task and ours.control_steps == theirs.control_steps
    ]
    level = corrected_level([_ends(sample) for *_, sample in found], _excludes_half)
    known_verdicts: dict[frozenset[str], bool] = {}
    if verdicts is not None:
        final = verdicts[verdicts["claim"] == "a"]
        names = map(frozenset, zip(final["configuration"], final["baseline"], strict=True))
        known_verdicts = dict(zip(names, final["verdict"].isin(["higher", "lower"]), strict=True))
    rows = []
    for one, other, sample in found:
        p, low, high, _ = sample.estimate()
        pair = frozenset((one.configuration, other.configuration))
        decided = known_verdicts.get(pair, _excludes_half(*_ends(sample)(1 - level)))
        for a, b, *numbers in ((one, other, p, low, high), (other, one, 1 - p, 1 - high, 1 - low)):
            labels = a.task, a.kind, a.configuration, b.configuration, a.label, b.label
            rows.append((*labels, *numbers, decided, int(a.longest)))
    return pd.DataFrame(rows, columns=PAIRS)


def _excludes_half(low: float, high: float) -> bool:
    return not low <= 0.5 <= high


def profile_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the share of runs above each return (Agarwal et al., 2021, section 4.2).

    The rows of `ALL_TASKS` are of the configurations that were trained on each task; every task has
    the same weight. Columns: `ID`, returns, seeds, final_return, share, low, high (pointwise 95%
    interval, for at least three seeds).

    Args:
        configurations: of one kind of return.
    """
    groups: dict[str, dict[tuple[str, int], list[Configuration]]] = {}
    for one in (one for one in configurations if len(seed_scores(one).final)):
        line = one.label, int(one.steps.max())
        groups.setdefault(one.task, {}).setdefault(line, []).append(one)
    groups = {task: groups[task] for task in in_order(groups)}
    if len(groups) > 1:
        first, *others = groups.values()
        shared = [line for line in first if all(line in other for other in others)]
        groups[ALL_TASKS] = {line: [other[line][0] for other in groups.values()] for line in shared}
    parts = [pd.DataFrame(columns=PROFILES)]
    for task, lines in groups.items():
        for same in lines.values():
            strata = [seed_scores(one).final for one in same]
            low = high = np.full(len(THRESHOLDS), np.nan)
            if min(map(len, strata)) >= st.MIN_SEEDS:
                low, high = st.profile_interval(strata, THRESHOLDS)
            names = {**same[0].identity, "task": task, "returns": same[0].kind}
            numbers = {"seeds": sum(map(len, strata)), "final_return": THRESHOLDS}
            numbers |= {"share": st.performance_profile(strata, THRESHOLDS)}
            parts.append(pd.DataFrame({**names, **numbers, "low": low, "high": high}))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def return_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the final returns of configurations that differ only in their representation.

    They are measured at the most frequent last step of these configurations, or at the latest of
    several such; those that have not reached it are left out. Columns: `ID`, returns, steps, seeds,
    iqm with its 95% interval (low, high).
    """
    rows = []
    for group in differing_in(configurations, "representation"):
        end = max(multimode(int(one.last_step) for one in group))
        for one in (one for one in group if one.last_step >= end):
            final = seed_scores(one, end).final
            value, low, high, _ = st.estimate(st.interquartile_mean, [final])
            numbers = {"steps": end, "seeds": len(final), "iqm": value, "low": low, "high": high}
            rows.append({**one.identity, "returns": one.kind, **numbers})
    return pd.DataFrame(rows, columns=[*ID, "returns", "steps", "seeds", "iqm", "low", "high"])
