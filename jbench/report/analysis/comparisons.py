"""Comparisons of two configurations: probability of improvement, differences of final returns."""

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import compared_scores
from jbench.report.data.cells import Cell, groups_same_but, verified
from jbench.settings.alike import comparable
from jbench.settings.variants import variant_labels

_MAX_NAMED = 8


class Comparison(NamedTuple):
    """Final returns of two cells, at the last control step that every seed of both has reached.

    Attributes:
        control_steps: at which they are compared.
        seeds: numbers of seeds of ours and of theirs with a final return.
        improvement: probability that a run of ours ends above one of theirs.
        difference: difference of the interquartile means, ours minus theirs.
        medians: difference of the medians, ours minus theirs.
    """

    ours: Cell
    theirs: Cell
    control_steps: int
    seeds: tuple[int, int]
    improvement: st.Estimate
    difference: st.Estimate
    medians: st.Estimate


def compare(ours: Cell, theirs: Cell) -> Comparison:
    """Compares two cells of the same kind of return."""
    one, other = compared_scores(ours, theirs)
    statistics = [
        st.probability_of_improvement,
        st.difference(st.interquartile_mean),
        st.difference(st.median),
    ]
    estimates = st.estimates(statistics, [one.final], [other.final])
    seeds = len(one.final), len(other.final)
    return Comparison(ours, theirs, one.control_steps, seeds, *estimates)


def pairs(cells: Sequence[Cell]) -> Iterator[tuple[Cell, Cell, st.Estimate]]:
    """Yields pairs of cells of a task, with the probability that a run of one ends above the other.

    Only runs on the plain robot are paired, of at least `DECIDING_SEEDS` seeds each that were
    trained equally long.
    """
    known = [
        (cell, scores)
        for cell in verified(cells)
        if not cell.robots
        for scores in compared_scores(cell)
        if len(scores.final) >= st.DECIDING_SEEDS
    ]
    for i, (one, ours) in enumerate(known):
        for other, theirs in known[i + 1 :]:
            if one.task == other.task and ours.control_steps == theirs.control_steps:
                finals = [ours.final], [theirs.final]
                yield one, other, st.estimate(st.probability_of_improvement, *finals)


def across(
    ours: Sequence[Cell], theirs: Sequence[Cell], names: Collection[str]
) -> list[tuple[Cell, Cell]]:
    """Returns the pairs of cells of two sides that differ only in the settings of these names."""
    by_settings: dict[str, list[Cell]] = {}
    for other in theirs:
        by_settings.setdefault(comparable(other.settings, *names), []).append(other)
    return [
        (one, other)
        for one in ours
        for other in by_settings.get(comparable(one.settings, *names), ())
        if not names or one.settings != other.settings
    ]


def alone(cells: Sequence[Cell], found: Sequence[tuple[Cell, Cell]]) -> list[str]:
    """Returns a sentence on the cells of one side without a comparison, if there are any."""
    left = _left(cells, found)
    if not left:
        return []
    names = [cell.name for cell in left]
    more = [f"and {len(names) - _MAX_NAMED} more"] if len(names) > _MAX_NAMED else []
    return [f"Only in {left[0].source}: {'; '.join([*names[:_MAX_NAMED], *more])}."]


def near_misses(
    ours: Sequence[Cell], theirs: Sequence[Cell], found: Sequence[tuple[Cell, Cell]]
) -> list[str]:
    """Returns a sentence for each pair of cells with the same name that says why it isn't compared.

    Only cells without a comparison count.
    """
    notes = []
    others = _left(theirs, found)
    for cell in _left(ours, found):
        for other in (other for other in others if _named(other) == _named(cell)):
            if cell.settings == other.settings:
                reason = f"{cell.source} and {other.source} have the same settings"
            else:
                labels = variant_labels({"a": cell.settings, "b": other.settings})
                mine, their = (labels[key].removesuffix(f" ({key})") for key in "ab")
                reason = f"{cell.source} has {mine}; {other.source} has {their}"
            notes.append(f"{' '.join(_named(cell))} is not compared: {reason}.")
    return notes


def _left(cells: Sequence[Cell], found: Sequence[tuple[Cell, Cell]]) -> list[Cell]:
    paired = [cell for pair in found for cell in pair]
    return [cell for cell in cells if not any(cell is one for one in paired)]


def _named(cell: Cell) -> tuple[str, str, str]:
    return cell.task, cell.algo, cell.representation


def algorithm_pairs(cells: Sequence[Cell]) -> Iterator[tuple[Cell, Cell]]:
    """Yields the pairs of cells that differ only in the algorithm and its settings.

    If algorithms have variants, each is only paired with the first variant of the other algorithm,
    to limit the number of pairs.
    """
    for group in groups_same_but(cells, "algo"):
        firsts = {cell.algo: cell for cell in reversed(group)}
        for i, one in enumerate(group):
            for other in group[i + 1 :]:
                first = one is firsts[one.algo] or other is firsts[other.algo]
                if one.algo != other.algo and first:
                    yield one, other
