"""Comparisons of configurations: two sides, methods, pairs."""

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import combinations
from typing import Any

import pandas as pd

from jbench.names import RETURNS
from jbench.report.analysis.all_tasks import Range, ranges, strata, together
from jbench.report.analysis.judging import Comparison, judge
from jbench.report.analysis.pair import IQM_DIFFERENCE, Pair
from jbench.report.analysis.schedules import remark_on_schedules
from jbench.report.data.configuration import Configuration, Configurations
from jbench.report.data.source_names import FILE
from jbench.representation_names import FULL
from jbench.settings.recorded import comparable
from jbench.settings.variants import variant_labels
from jbench.statistics import bootstrap as st
from jbench.statistics.permutation import p_value
from jbench.statistics.verdicts import DECIDING_SEEDS, DIRECTIONS, Evidence, corrected_verdicts
from jbench.studies.quantities import FINAL_RETURN

PAIRS = ["task", "returns", "a", "b", "a_label", "b_label", "p", "low", "high", "decided", "steps"]
COMPARISONS = [
    "task",
    "algo",
    "representation",
    "words",
    "against",
    "returns",
    "a",
    "b",
    "seeds_a",
    "seeds_b",
    "steps",
    "p",
    "p_low",
    "p_high",
    "difference",
    "low",
    "high",
    "median_difference",
    "median_low",
    "median_high",
    "corrected_low",
    "corrected_high",
    "verdict",
    "text",
    "remark",
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
    a run of the first has a higher final return than one of the second. A group is one pair, or one
    on each of several tasks.
    """
    rows: list[dict[str, Any]] = []
    for kind in RETURNS:
        chosen = [pairs for pairs in groups if pairs[0].ours.returns_name == kind]
        known = ranges([config for pairs in chosen for pair in pairs for config in pair.sides])
        family = [_compared(pairs, known) for pairs in chosen]
        judgments = judge(family)
        rows += [one.row(judgment) for one, judgment in zip(family, judgments, strict=True)]

    for row in rows:
        # Of two sides, the title of the table says which is compared with which.
        if row["source"] == FILE and row["verdict"] in FINAL_RETURN.directions:
            row["text"] = f"{row['a']} {row['text']}"

    return pd.DataFrame(rows, columns=COMPARISONS)


def _compared(pairs: Sequence[Pair], known: Mapping[str, Range]) -> Comparison:
    """Compares two sides on one task, or on all tasks together with scores scaled to [0, 1]."""
    ours, theirs = pairs[0].sides
    names: dict[str, Any] = {**ours.identity, "a": ours.source, "b": theirs.source}
    names["against"] = _named_beside(ours, theirs)
    if ours.source == FILE:
        names["algo"] = ""
        names["against"] = ""
        names["a"] = ours.label
        names["b"] = theirs.label
    if len(pairs) > 1:
        names["task"] = together(known)

    places = [known[pair.ours.task] for pair in pairs]
    sides = zip(*(pair.finals for pair in pairs), strict=True)
    first, other = (strata(finals, places)[0] for finals in sides)
    names["seeds_a"] = sum(map(len, first))
    names["seeds_b"] = sum(map(len, other))
    names["steps"] = max(pair.control_steps for pair in pairs)

    samples = dict(zip(_NUMBERS, st.samples([*_NUMBERS], first, other), strict=True))
    for statistic, columns in _NUMBERS.items():
        names |= zip(columns, samples[statistic].estimate(), strict=False)

    sample = samples[IQM_DIFFERENCE]

    @cache
    def p_of_difference(shift: float) -> float:
        shifted = [scores + shift for scores in first]
        return p_value(shifted, other, sample.value + shift)

    evidence = Evidence(
        sample.estimate,
        p_of_difference,
        seeds=min(pair.seeds for pair in pairs),
        margin=ours.margin if len(pairs) == 1 else 0.0,  # scaled scores have none
    )
    remarks = (remark_on_schedules(pair, FINAL_RETURN) for pair in pairs)
    return Comparison(FINAL_RETURN, names, evidence, next(filter(None, remarks), ""))


def _named_beside(ours: Configuration, theirs: Configuration) -> str:
    """Returns the representation and words of the second of a pair; its algorithm if it differs."""
    named = str(theirs.identity["representation"])
    if theirs.algo != ours.algo:
        named = f"{theirs.identity['algo']} {named}"
    return ", ".join(filter(None, (named, theirs.words)))


def method_pairs(configurations: Configurations) -> list[list[Pair]]:
    """Returns the pairs of methods of a file on each task, and on all together."""
    groups: dict[tuple[str, str], list[Pair]] = {}
    for first, other in combinations(configurations, 2):
        if first.task == other.task:
            groups.setdefault((first.label, other.label), []).append(Pair(first, other))
    tasks = {config.task for config in configurations}
    alone = [[pair] for pairs in groups.values() for pair in pairs]
    return alone + [pairs for pairs in groups.values() if len(pairs) == len(tasks) > 1]


def across(ours: Configurations, theirs: Configurations, names: Collection[str]) -> list[Pair]:
    """Returns the pairs of two sides that differ only in the settings of these names."""
    by_settings: dict[str, list[Configuration]] = {}
    for other in theirs:
        by_settings.setdefault(comparable(other.settings, *names), []).append(other)

    return [
        Pair(first, other)
        for first in ours
        for other in by_settings.get(comparable(first.settings, *names), ())
        if first.returns_name == other.returns_name and not (names and _is_same(first, other))
    ]


def _is_same(first: Configuration, other: Configuration) -> bool:
    """Returns whether both sides of a comparison have chosen the same runs."""
    return first.settings == other.settings and not {*first.runs}.isdisjoint(other.runs)


def left_out(ours: Configurations, theirs: Configurations, pairs: Sequence[Pair]) -> list[str]:
    """Returns sentences on the configurations of two sides without a comparison, and why."""
    paired = {id(config) for pair in pairs for config in pair.sides}
    left = [[c for c in side if id(c) not in paired] for side in (ours, theirs)]
    notes = []
    for side in filter(None, left):
        names = [config.name for config in side]
        if len(names) > _MAX_NAMED:
            names = [*names[:_MAX_NAMED], f"and {len(names) - _MAX_NAMED} more"]
        notes.append(f"Only in {side[0].source}: {'; '.join(names)}.")

    for first in left[0]:
        named = [first.task, first.algo, first.representation]
        for other in (o for o in left[1] if [o.task, o.algo, o.representation] == named):
            reason = f"{first.source} and {other.source} have the same settings"
            if first.settings != other.settings:
                labels = variant_labels({"a": first.settings, "b": other.settings})
                mine, their = (labels[key].removesuffix(f" ({key})") for key in "ab")
                reason = f"{first.source} has {mine}; {other.source} has {their}"

            notes.append(f"{' '.join(named)} is not compared: {reason}.")

    return notes


def _with_enough_seeds(configurations: Configurations) -> list[Configuration]:
    """Returns the configurations on the plain robot that may have a verdict."""
    return [c for c in configurations if not c.robots and len(c.seeds) >= DECIDING_SEEDS]


def pair_frame(configurations: Configurations, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Returns the probability that a run of a has a higher final return than one of b, both ways.

    Only runs on the plain robot are paired, of at least `DECIDING_SEEDS` seeds each that were
    trained equally long. p has a 95% interval. decided is as in the verdicts on the same kind of
    return; for other pairs, 0.5 has to be outside of an interval corrected for their number, and a
    permutation test has to confirm it.
    """
    compared: dict[tuple[Configuration, Configuration], Evidence] = {}
    for pair in combinations(_with_enough_seeds(configurations), 2):
        # Resampled in an order of their own, so that the order on the page changes no number.
        first, other = sorted(pair, key=lambda c: (c.representation != FULL, c.representation))
        if (first.task, first.trained) != (other.task, other.trained):
            continue

        scored = Pair(first, other)
        if scored.seeds >= DECIDING_SEEDS:
            compared[first, other] = scored.improvement()

    judged, _ = corrected_verdicts([*compared.values()])

    final = verdicts[verdicts["claim"] == FINAL_RETURN.claim]
    names = map(frozenset, zip(final["configuration"], final["baseline"], strict=True))
    known = dict(zip(names, final["verdict"].isin(FINAL_RETURN.directions), strict=True))

    rows = []
    for (sides, evidence), verdict in zip(compared.items(), judged, strict=True):
        first, other = sides
        p, low, high, _ = evidence.estimate(0.95)
        key = frozenset((first.configuration, other.configuration))
        decided = known.get(key, verdict in DIRECTIONS)
        both = (first, other, p, low, high), (other, first, 1 - p, 1 - high, 1 - low)
        for a, b, *numbers in both:
            labels = a.task, a.returns_name, a.configuration, b.configuration, a.label, b.label
            rows.append((*labels, *numbers, decided, int(a.longest)))

    return pd.DataFrame(rows, columns=PAIRS)
