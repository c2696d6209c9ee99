"""Values of tables: estimates with their intervals, counts of seeds, names of cells."""

import math
from collections.abc import Iterable, Sequence

from jbench.report.analysis.claims import Finding
from jbench.report.analysis.scores import Statistic, Summary, final_percentiles, scores_of
from jbench.report.analysis.statistics import Estimate
from jbench.report.data.cells import OURS, SOLVED, Cell
from jbench.report.document import Value
from jbench.report.formatting import Form, display_name, ratio, span, steps, whole
from jbench.wording import counted


def estimate(one: Estimate, form: Form = whole) -> Value | None:
    """Formats a number with its interval, if it has one: `668 [640, 690]`."""
    if math.isnan(one.value):
        return None
    ends = {"low": one.low, "high": one.high}
    known = {name: None if math.isnan(end) else end for name, end in ends.items()}
    numbers: dict[str, float | None] = {"": one.value, **known}
    text = _bounded(one.value, form, "infinite")
    # An interval that begins at infinity adds no information.
    if None not in known.values() and math.isfinite(one.low):
        low, high = form(one.low), _bounded(one.high, form, "no upper bound")
        text = f"{text} [{low}, {high}]"
    return Value(text, one.value, numbers=numbers)


def against_solved(value: float) -> str:
    """Formats a return; one that is just below `SOLVED` has a decimal: 899.6 must not read 900."""
    return f"{math.floor(10 * value) / 10:,}" if SOLVED - 0.5 <= value < SOLVED else whole(value)


def of_statistic(
    summary: Summary, measure: str, statistic: str, form: Form = whole
) -> Value | None:
    """Formats a statistic of a cell with its interval; see `scores.Statistic`."""
    one = summary.get(measure, statistic)
    return None if one is None else estimate(one.estimate, form)


def by_episodes(finding: Finding) -> Value | None:
    """Formats the effect that episodes alone would cause; see `Finding`."""
    effect = finding.by_episodes
    return None if math.isnan(effect) else Value(ratio(effect), effect)


def reached(one: Statistic | None) -> Value | None:
    """Formats how many seeds reach a threshold: `3 of 10`."""
    if one is None or one.reached is None:
        return None
    numbers = {"": one.reached, "of": one.seeds}
    return Value(f"{one.reached} of {one.seeds}", one.reached / max(one.seeds, 1), numbers=numbers)


def spread(cell: Cell, *, best: bool = False) -> Value | None:
    """Formats the median over seeds with its 10th and 90th percentiles and the number of seeds."""
    seeds, (low, median, high) = len(scores_of(cell).final), final_percentiles(cell)
    if not seeds:
        return None
    band = f" [{whole(low)}, {whole(high)}]" if seeds > 1 else ""
    numbers = {"": median, "10th percentile": low, "90th percentile": high, "n": seeds}
    numbers |= {"diverged": cell.diverged_count} if cell.diverged_count else {}
    return Value(f"{whole(median)}{band}, {count_of(cell, seeds)}", median, best, numbers)


def cell_name(cell: Cell) -> str:
    """Names a cell in a sentence."""
    return f"{cell.prefix}{cell.task} {display_name(cell.algo)} {cell.representation_label}"


def algorithm_name(cell: Cell) -> str:
    """Names a cell within a task: its source, algorithm and representation."""
    return f"{cell.prefix}{display_name(cell.algo)}, {cell.representation_words}"


def count_of(cell: Cell, seeds: int) -> str:
    """Formats how many seeds a number is computed from, and how many of them diverged."""
    lost = f", {cell.diverged_count} of {len(cell.seeds)} diverged" if cell.diverged_count else ""
    return f"n = {seeds}{lost}"


def seeds(cell: Cell) -> str:
    """Formats the number of seeds of a cell, and how many of them diverged."""
    lost = f", {cell.diverged_count} diverged" if cell.diverged_count else ""
    return counted(len(cell.seeds), "seed") + lost


def on_divergence(cells: Iterable[Cell]) -> str:
    """Returns a sentence on how diverged seeds count, if there are any."""
    lost = any(cell.diverged_count for cell in cells)
    return " A seed that diverged counts with return 0 from then on." if lost else ""


def trained(cell: Cell) -> Value:
    """Formats the number of control steps for which the seeds of a cell were trained."""
    return steps_between(*cell.trained)


def steps_between(low: int, high: int) -> Value:
    """Formats a range of control steps: `300k–1M`."""
    return Value(span((low, high), steps), high, numbers={"least": low, "most": high})


def counts(seeds: tuple[int, int], other: str) -> Value:
    """Formats the numbers of seeds of two compared cells, `this` and `other`: `10, 8`."""
    return Value(f"{seeds[0]}, {seeds[1]}", min(seeds), numbers={"this": seeds[0], other: seeds[1]})


def at_step(control_steps: int) -> Value:
    """Formats the control steps at which something is measured: `300k`."""
    return Value(steps(control_steps), control_steps)


def names(cells: Sequence[Cell], *, task: bool = True) -> list[dict[str, object]]:
    """Returns the first columns of a table with a row for each cell."""
    sources = any(cell.source != OURS for cell in cells)
    return [
        {
            **({"runs": cell.source} if sources else {}),
            **({"task": cell.task} if task else {}),
            "algorithm": display_name(cell.algo),
            "observation": cell.representation_words,
        }
        for cell in cells
    ]


def _bounded(value: float, form: Form, infinite: str) -> str:
    """Formats a number that may be infinite; `steps` formats infinity itself."""
    return form(value) if math.isfinite(value) or form is steps else infinite
