"""How numbers read: returns, differences of returns, ratios and control steps."""

import math

from jbench.task_specs import SOLVED_RETURN

_ZERO = 1e-6
_SMALL = 9.95
"""Numbers between them have two significant digits."""


def whole(value: float) -> str:
    """Formats a return; one just below `SOLVED_RETURN` has a decimal: 899.6 must not read 900."""
    if _ZERO < abs(value) < _SMALL:
        return f"{value:.2g}"
    if SOLVED_RETURN - 0.5 <= value < SOLVED_RETURN:
        return f"{math.floor(10 * value) / 10:,}"
    return f"{round(value):,d}" if math.isfinite(value) else "infinite"


def signed(value: float) -> str:
    """Formats a difference of returns."""
    if _ZERO < abs(value) < _SMALL:
        return f"{value:+.2g}"
    return f"{round(value):+,d}" if abs(value) > _ZERO else "0"


def fixed(value: float, places: int, sign: str = "-") -> str:
    """Formats a return with a number of decimals, and a difference with the sign "+"."""
    if not math.isfinite(value):
        return whole(value)
    if sign == "-" and SOLVED_RETURN - 0.5 <= value < SOLVED_RETURN:  # as by `whole`
        value = math.floor(value * 10**places) / 10**places
    return f"{value:{sign}z,.{places}f}"


def rounded(value: float) -> str:
    """Formats a difference of returns without decimals."""
    text = f"{value:+.0f}"
    return "0" if text in ("+0", "-0") else text


def ratio(value: float) -> str:
    """Formats a ratio or a probability; one that rounds to zero has no sign."""
    return f"{value:z.2f}"


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
