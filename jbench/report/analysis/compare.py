"""Comparisons of configurations: two sides, pairs, profiles."""

from collections.abc import Collection, Sequence
from itertools import combinations
from statistics import multimode
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.analysis.scores import IQM_DIFFERENCE, Comparison, ends, seed_scores
from jbench.report.analysis.verdicts import corrected_level, difference_text, judged
from jbench.report.data.configuration import (
    ID,
    Configuration,
    concatenated,
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
_NUMBERS = {
    st.probability_of_improvement: ("p", "p_low", "p_high"),
    IQM_DIFFERENCE: ("difference", "low", "high"),
    st.difference(st.median): ("median_difference", "median_low", "median_high"),
}
ALL_TASKS = "all tasks"
THRESHOLDS = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is computed."""

_MAX_NAMED = 8


def comparison_frame(pairs: Sequence[tuple[Configuration, Configuration]]) -> pd.DataFrame:
    """Returns a row per comparison of two sides, the first minus the second, with 95% intervals.

    The verdict rests on an interval that is corrected for the number of comparisons by the same
    kind of return. Differences are of interquartile means and of medians; p is the probability that
    a run of the first ends above one of the second.
    """
    rows = []
    for kind in KINDS:
        same = [pair for pair in pairs if pair[0].kind == kind]
        found = [Comparison(*pair) for pair in same]
        decidable = [ends(one.sample(IQM_DIFFERENCE)) for one in found if one.decidable]
        level = corrected_level(decidable)
        for (ours, theirs), one in zip(same, found, strict=True):
            row: dict[str, Any] = {**ours.identity, "returns": kind}
            row |= {"a": ours.source, "b": theirs.source, "steps": one.control_steps}
            row |= {"seeds_a": len(one.ours.final), "seeds_b": len(one.theirs.final)}
            for statistic, names in _NUMBERS.items():
                row |= zip(names, one.sample(statistic).estimate(), strict=False)
            low, high = ends(one.sample(IQM_DIFFERENCE))(1 - level)
            verdict = judged(low, high) if one.decidable else "undecided"
            text = f"{verdict}: {difference_text(low, high)}"
            if np.isnan(low):
                text = f"{signed(row['difference'])}, too few seeds"
            elif verdict in ("higher", "lower"):
                text = f"{ours.source} {difference_text(low, high)}"
            rows.append({**row, "corrected_low": low, "corrected_high": high, "text": text})
    return pd.DataFrame(rows, columns=COMPARISONS)


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
    trained equally long. Columns: task, returns, a, b (configurations), their labels, p with its
    95% interval (low, high), decided (as in the verdicts on the same kind of return; for others,
    whether 0.5 is outside of the interval that is corrected for the number of pairs), steps (of
    training).
    """
    plain = [one for one in verified(configurations) if not one.robots]
    found = [
        (one, other, compared)
        for one, other in combinations(plain, 2)
        if one.task == other.task and int(one.last_step) == int(other.last_step)
        if (compared := Comparison(one, other)).decidable
    ]
    samples = [compared.sample(st.probability_of_improvement) for *_, compared in found]
    level = corrected_level(list(map(ends, samples)), _excludes_half)
    known: dict[frozenset[str], bool] = {}
    if verdicts is not None:
        final = verdicts[verdicts["claim"] == "a"]
        names = map(frozenset, zip(final["configuration"], final["baseline"], strict=True))
        known = dict(zip(names, final["verdict"].isin(["higher", "lower"]), strict=True))
    rows = []
    for (one, other, _), sample in zip(found, samples, strict=True):
        p, low, high, _ = sample.estimate()
        pair = frozenset((one.configuration, other.configuration))
        decided = known.get(pair, _excludes_half(*ends(sample)(1 - level)))
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
    parts = []
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
    return concatenated(parts, PROFILES)


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
