"""How numbers, intervals and cells are said in the tables of a report."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from jbench.report.cells import OURS, Cell
from jbench.report.curves import FloatArray
from jbench.report.document import Value
from jbench.report.figures import display_name
from jbench.report.scores import Statistic
from jbench.report.statistics import Estimate

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


def millions(value: float) -> str:
    """Says control steps, in millions."""
    return f"{value / 1e6:.3g}"


def estimate(found: Estimate | None, say: Callable[[float], str] = whole) -> Value | None:
    """Says a number with its 95% interval, if it has one: `668 [640, 690]`."""
    if found is None or math.isnan(found.value):
        return None
    ends = (found.low, found.high)
    # An interval that begins where nothing is reached says nothing more.
    if np.isnan(ends).any() or math.isinf(found.low):
        return Value(_said(found.value, say), found.value)
    low, high = (_said(end, say) for end in ends)
    return Value(f"{_said(found.value, say)} [{low}, {high}]", found.value)


def of_statistic(one: Statistic | None, say: Callable[[float], str] = whole) -> Value | None:
    """Says a statistic with its interval."""
    return None if one is None else estimate(one.estimate, say)


def reached(one: Statistic | None) -> Value | None:
    """Says how many seeds reach a threshold: `3 of 10`."""
    if one is None or one.reached is None:
        return None
    return Value(f"{one.reached} of {one.seeds}", one.reached / max(one.seeds, 1))


def spread(final: FloatArray, *, best: bool = False) -> Value | None:
    """Says the median of seeds, their 10th and 90th percentile, and how many they are."""
    if not len(final):
        return None
    low, median, high = np.percentile(final, (10, 50, 90))
    band = f" [{whole(low)}, {whole(high)}]" if len(final) > 1 else ""
    return Value(f"{whole(median)}{band}, n = {len(final)}", float(median), best)


def episodes(cell: Cell) -> Value:
    """Says how many episodes the seeds of a cell have."""
    low, high = int(cell.lengths.min()), int(cell.lengths.max())
    return Value(f"{low:,}" if low == high else f"{low:,}\N{EN DASH}{high:,}", low)


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


def _said(value: float, say: Callable[[float], str]) -> str:
    return say(value) if math.isfinite(value) else NOT_REACHED
