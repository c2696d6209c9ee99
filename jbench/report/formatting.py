"""How numbers, intervals and cells are said in the tables of a report."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from jbench.report.analysis.scores import Statistic, scores_of
from jbench.report.analysis.statistics import Estimate
from jbench.report.data.cells import OURS, Cell
from jbench.report.document import Value
from jbench.report.figures.learning_curves import display_name

NOT_REACHED = "not reached"


def whole(value: float) -> str:
    """Says a return."""
    # Of a small negative number, "-0" would be left.
    return f"{round(value):,d}"


def signed(value: float) -> str:
    """Says a difference of returns."""
    return f"{round(value):+,d}" if round(value) else "0"


def ratio(value: float) -> str:
    """Says a ratio, or a probability."""
    return f"{value:.2f}"


def steps(value: float) -> str:
    """Says control steps in the unit that fits: `500`, `22.5k`, `300k`, `1M`."""
    if math.isinf(value):
        return NOT_REACHED
    # Rounded first, so that 999,900 becomes 1M instead of 1e+03k.
    rounded = float(f"{value:.3g}")
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if rounded >= size:
            return f"{rounded / size:g}{unit}"
    return f"{rounded:g}"


def estimate(found: Estimate | None, say: Callable[[float], str] = whole) -> Value | None:
    """Says a number with its 95% interval, if it has one: `668 [640, 690]`."""
    if found is None or math.isnan(found.value):
        return None
    ends = (found.low, found.high)
    known = {
        name: None if math.isnan(x) else x for name, x in zip(("low", "high"), ends, strict=True)
    }
    numbers: dict[str, float | None] = {"": found.value, **known}
    text = _bounded(found.value, say, "infinite")
    # An interval that begins where nothing is reached says nothing more.
    if not (np.isnan(ends).any() or math.isinf(found.low)):
        low, high = say(found.low), _bounded(found.high, say, "no upper bound")
        text = f"{text} [{low}, {high}]"
    return Value(text, found.value, numbers=numbers)


def of_statistic(one: Statistic | None, say: Callable[[float], str] = whole) -> Value | None:
    """Says a statistic with its interval."""
    return None if one is None else estimate(one.estimate, say)


def reached(one: Statistic | None) -> Value | None:
    """Says how many seeds reach a threshold: `3 of 10`."""
    if one is None or one.reached is None:
        return None
    numbers = {"": one.reached, "of": one.seeds}
    return Value(f"{one.reached} of {one.seeds}", one.reached / max(one.seeds, 1), numbers=numbers)


def spread(cell: Cell, *, best: bool = False) -> Value | None:
    """Says the median of seeds, their 10th and 90th percentile, and how many they are."""
    final = scores_of(cell).final
    if not len(final):
        return None
    low, median, high = np.percentile(final, (10, 50, 90))
    band = f" [{whole(low)}, {whole(high)}]" if len(final) > 1 else ""
    numbers = {"": median, "10th percentile": low, "90th percentile": high, "n": len(final)}
    numbers |= {"diverged": int(cell.diverged.sum())} if cell.diverged.any() else {}
    text = f"{whole(median)}{band}, {count_of(cell, len(final))}"
    return Value(text, float(median), best, {name: _plain(x) for name, x in numbers.items()})


def count_of(cell: Cell, seeds: int) -> str:
    """Says how many seeds a number is of, and how many of them diverged."""
    return f"n = {seeds}" + (f", {diverged(cell)}" if cell.diverged.any() else "")


def diverged(cell: Cell) -> str:
    """Says how many seeds of a cell diverged: `2 of 10 diverged`."""
    return f"{cell.diverged.sum()} of {len(cell.seeds)} diverged"


def trained(cell: Cell) -> Value:
    """Says for how many control steps the seeds of a cell were trained."""
    low, high = int(cell.steps.min()), int(cell.steps.max())
    numbers = {"least": low, "most": high}
    said = dict.fromkeys((steps(low), steps(high)))
    return Value("\N{EN DASH}".join(said), high, numbers=numbers)


def names(cells: Sequence[Cell], *, task: bool = True) -> list[dict[str, object]]:
    """Returns the first columns of a table with a row for each cell."""
    sources = any(cell.source != OURS for cell in cells)
    return [
        {
            **({"runs": cell.source} if sources else {}),
            **({"task": cell.task} if task else {}),
            "algorithm": display_name(cell.algo),
            "observation": cell.seen,
        }
        for cell in cells
    ]


def _bounded(value: float, say: Callable[[float], str], infinite: str) -> str:
    """Says a number that may be infinite; steps have a word of their own for that."""
    return say(value) if math.isfinite(value) or say is steps else infinite


def _plain(value: float) -> float:
    """Returns a number of numpy as Python's own."""
    return value if isinstance(value, int) else float(value)
