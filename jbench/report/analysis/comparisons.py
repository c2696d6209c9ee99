"""Comparisons of two cells: probability of improvement, and differences of final returns."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import baseline_of, compared_scores, scores_of
from jbench.report.data.cells import Cell, groups_same_but
from jbench.report.formatting import listed
from jbench.settings.alike import comparable
from jbench.settings.variants import variant_labels

_MAX_NAMED = 8


@dataclass(frozen=True)
class Comparison:
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

    @property
    def cut(self) -> int:
        """Number of control steps of the longest run that are not compared."""
        return int(max(self.ours.longest, self.theirs.longest)) - self.control_steps


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


def within(cells: Sequence[Cell]) -> list[Comparison]:
    """Compares the cells of results that differ in one respect only.

    Each representation is compared with the full observation, each algorithm with those after it in
    the paper's order, and each variant with the first variant.
    """
    pairs = [
        (cell, baseline) for cell in cells if (baseline := baseline_of(cell, cells)) is not None
    ]
    pairs += algorithm_pairs(cells)
    firsts: dict[tuple[str, ...], Cell] = {}
    for cell in cells:
        first = firsts.setdefault((cell.source, cell.task, cell.algo, cell.representation), cell)
        if first is not cell:
            pairs.append((cell, first))
    return [compare(*pair) for pair in pairs]


def across(
    ours: Sequence[Cell], theirs: Sequence[Cell], names: Collection[str]
) -> list[Comparison]:
    """Compares the cells of two sides that differ only in the settings of these names."""
    by_settings: dict[str, list[Cell]] = {}
    for other in theirs:
        by_settings.setdefault(comparable(other.settings, *names), []).append(other)
    return [
        compare(one, other)
        for one in ours
        for other in by_settings.get(comparable(one.settings, *names), ())
        if not names or one.settings != other.settings
    ]


def alone(cells: Sequence[Cell], found: Sequence[Comparison]) -> list[str]:
    """Returns a sentence on the cells of one side without a comparison, if there are any."""
    left = _left(cells, found)
    if not left:
        return []
    names = [cell.name_in_source for cell in left]
    return [f"Only in {left[0].source}: {listed(names, _MAX_NAMED)}."]


def near_misses(
    ours: Sequence[Cell], theirs: Sequence[Cell], found: Sequence[Comparison]
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


def _left(cells: Sequence[Cell], found: Sequence[Comparison]) -> list[Cell]:
    paired = [cell for one in found for cell in (one.ours, one.theirs)]
    return [cell for cell in cells if not any(cell is one for one in paired)]


def _named(cell: Cell) -> tuple[str, str, str]:
    return cell.task, cell.algo, cell.representation


def comparisons_frame(found: Sequence[Comparison]) -> pd.DataFrame:
    """Returns a row per comparison with the exact numbers of the tables.

    Columns: returns (kind), task; source, algo, representation, variant, settings and seeds, each
    with the suffixes _a and _b; control_steps (at which they are compared); and for a against b,
    probability_of_improvement, iqm_difference and median_difference of the final returns, each
    with the ends of its 95% interval (…_low, …_high).
    """
    return pd.DataFrame([_row(one) for one in found])


def _row(one: Comparison) -> dict[str, object]:
    row: dict[str, object] = {"returns": one.ours.kind.name, "task": one.ours.task}
    names = ("source", "algo", "representation", "variant")
    for side, cell, seeds in zip("ab", (one.ours, one.theirs), one.seeds, strict=True):
        row |= {f"{name}_{side}": getattr(cell, name) for name in names}
        row |= {f"settings_{side}": cell.label, f"seeds_{side}": seeds}
    row["control_steps"] = one.control_steps
    estimates = {
        "probability_of_improvement": one.improvement,
        "iqm_difference": one.difference,
        "median_difference": one.medians,
    }
    for name, estimate in estimates.items():
        row |= {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
    return row


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


def best_of(cells: Sequence[Cell]) -> Cell | None:
    """Returns the cell whose median final return is above that of every other, or None.

    The 95% interval of the difference of medians must lie above 0 for every other cell, and both
    cells must have at least `DECIDING_SEEDS` seeds. The largest median alone is not enough.
    """
    learned = [cell for cell in cells if len(scores_of(cell).final)]
    if len(cells) < 2 or not learned:
        return None
    best = max(learned, key=lambda cell: float(np.median(scores_of(cell).final)))
    return best if all(_is_above(best, other) for other in cells if other is not best) else None


def _is_above(one: Cell, other: Cell) -> bool:
    """Returns whether the median final return of a cell is certainly above that of another."""
    finals = [scores.final for scores in compared_scores(one, other)]
    if min(map(len, finals)) < st.DECIDING_SEEDS:
        return False
    return st.estimate(st.difference(st.median), *([final] for final in finals)).low > 0
