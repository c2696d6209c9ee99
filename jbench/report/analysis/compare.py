"""Comparisons of configurations: two sides, methods, pairs."""

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from statistics import multimode
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.analysis.claims import MARGIN
from jbench.report.analysis.scores import IQM_DIFFERENCE, Comparison, Ends, Pair, ends, seed_scores
from jbench.report.analysis.tasks import Range, ranges, strata, together
from jbench.report.analysis.verdicts import corrected_level, difference_text, judged
from jbench.report.data.configuration import ID, Configuration, differing_in, verified
from jbench.report.data.returns import FILE, KINDS, signed
from jbench.settings.alike import comparable
from jbench.settings.variants import variant_labels
from jbench.statistics import bootstrap as st

PAIRS = [
    *("task", "returns", "a", "b", "a_label", "b_label", "p", "low", "high", "decided", "steps"),
]
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

_MAX_NAMED = 8


def comparison_frame(groups: Sequence[Sequence[Pair]]) -> pd.DataFrame:
    """Returns a row per comparison of two sides, the first minus the second, with 95% intervals.

    The verdict rests on an interval that is corrected for the number of comparisons by the same
    kind of return. Differences are of interquartile means and of medians; p is the probability that
    a run of the first has a higher final return than one of the second. Returns of a file have no
    margin within which they are similar.

    Args:
        groups: two configurations each, on one task or on each of several; see `method_pairs`.
    """
    margin = 0.0 if any(same[0][0].source == FILE for same in groups) else MARGIN

    def decides(low: float, high: float) -> bool:
        return judged(low, high, margin=margin) != "undecided"

    rows = []
    for kind in KINDS:
        of_kind = [same for same in groups if same[0][0].kind == kind]
        known = ranges([one for same in of_kind for pair in same for one in pair])
        found = [_compared(same, known) for same in of_kind]
        level = corrected_level([interval for _, interval, enough in found if enough], decides)
        for row, interval, enough in found:
            low, high = interval(1 - level)
            verdict = judged(low, high, margin=margin) if enough else "undecided"
            text = f"{verdict}: {difference_text(low, high)}"
            if np.isnan(low):
                text = f"{signed(row['difference'])}, too few seeds"
            elif verdict in ("higher", "lower"):
                text = f"{row['a']} {difference_text(low, high)}"
            rows.append({**row, "corrected_low": low, "corrected_high": high, "text": text})
    return pd.DataFrame(rows, columns=COMPARISONS)


def _compared(
    same: Sequence[Pair], known: Mapping[str, Range]
) -> tuple[dict[str, Any], Ends, bool]:
    """Returns numbers of `comparison_frame`, the difference's interval, and whether it decides."""
    ours, theirs = same[0]
    row: dict[str, Any] = {**ours.identity, "returns": ours.kind}
    row |= {"a": ours.source, "b": theirs.source}
    if ours.source == FILE:
        row |= {"algo": "", "a": ours.label, "b": theirs.label}
    if len(same) > 1:
        row["task"] = together(known)
    compared = [Comparison(*pair) for pair in same]
    places = [known[one.task] for one, _ in same]
    first, _ = strata([one.ours.final for one in compared], places)
    other, _ = strata([one.theirs.final for one in compared], places)
    row["steps"] = max(one.control_steps for one in compared)
    row |= {"seeds_a": sum(map(len, first)), "seeds_b": sum(map(len, other))}
    samples = dict(zip(_NUMBERS, st.samples([*_NUMBERS], first, other), strict=True))
    for statistic, names in _NUMBERS.items():
        row |= zip(names, samples[statistic].estimate(), strict=False)
    return row, ends(samples[IQM_DIFFERENCE]), all(one.decidable for one in compared)


def method_pairs(configurations: Sequence[Configuration]) -> list[list[Pair]]:
    """Returns the pairs of methods of a file on each task, and on all together."""
    groups: dict[tuple[str, str], list[Pair]] = {}
    for one, other in combinations(configurations, 2):
        if one.task == other.task:
            groups.setdefault((one.label, other.label), []).append((one, other))
    tasks = {one.task for one in configurations}
    alone = [[pair] for same in groups.values() for pair in same]
    return alone + [same for same in groups.values() if len(same) == len(tasks) > 1]


def across(
    ours: Sequence[Configuration], theirs: Sequence[Configuration], names: Collection[str]
) -> list[Pair]:
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
    pairs: Sequence[Pair],
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
    """Returns the probability that a run of a has a higher final return than one of b, both ways.

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
