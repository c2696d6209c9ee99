"""Numbers as people read them."""

import math

from jbench.report.data.cells import SOLVED


def whole(value: float) -> str:
    """Formats a return; one just below `SOLVED` has a decimal: 899.6 must not read 900."""
    if SOLVED - 0.5 <= value < SOLVED:
        return f"{math.floor(10 * value) / 10:,}"
    return f"{round(value):,d}" if math.isfinite(value) else "infinite"


def signed(value: float) -> str:
    """Formats a difference of returns."""
    return f"{round(value):+,d}" if round(value) else "0"


def ratio(value: float) -> str:
    """Formats a ratio or a probability."""
    return f"{value:.2f}"


def steps(value: float) -> str:
    """Formats control steps in the unit that fits: `500`, `22.5k`, `300k`, `1M`."""
    if math.isinf(value):
        return "not reached"
    # Rounded first, so that 999,900 becomes 1M instead of 1e+03k.
    rounded = float(f"{value:.3g}")
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if rounded >= size:
            return f"{rounded / size:g}{unit}"
    return f"{rounded:g}"
