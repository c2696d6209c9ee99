"""Formats numbers and names for the sentences, tables and figures of a report."""

import math
from collections.abc import Callable, Sequence

from jbench.names import ALGORITHMS

NOT_REACHED = "not reached"

Form = Callable[[float], str]
"""Formats a number."""


def whole(value: float) -> str:
    """Formats a return."""
    return f"{round(value):,d}"


def signed(value: float) -> str:
    """Formats a difference of returns."""
    return f"{round(value):+,d}" if round(value) else "0"


def ratio(value: float) -> str:
    """Formats a ratio or a probability."""
    return f"{value:.2f}"


def steps(value: float) -> str:
    """Formats control steps in the unit that fits: `500`, `22.5k`, `300k`, `1M`."""
    if math.isinf(value):
        return NOT_REACHED
    # Rounded first, so that 999,900 becomes 1M instead of 1e+03k.
    rounded = float(f"{value:.3g}")
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if rounded >= size:
            return f"{rounded / size:g}{unit}"
    return f"{rounded:g}"


def capitalized(text: str) -> str:
    """Returns a text with its first character in upper case and the others as they are."""
    return text[0].upper() + text[1:]


def listed(texts: Sequence[str], most: int) -> str:
    """Joins the first texts, and counts the others if there are any: `a; b; and 3 more`."""
    more = [f"and {len(texts) - most} more"] if len(texts) > most else []
    return "; ".join([*texts[:most], *more])


def span(numbers: Sequence[float], form: Form) -> str:
    """Formats the smallest and the largest number: `300k–1M`, or `300k` if both read the same."""
    return "\N{EN DASH}".join(dict.fromkeys((form(min(numbers)), form(max(numbers)))))


def display_name(algo: str) -> str:
    """Returns an algorithm's name as the paper writes it, or as its author does.

    The label `TD3` of a recorded or imported algorithm differs from that of jbench's td3.
    """
    if algo in ALGORITHMS:
        return algo.upper()
    return f"{algo} (label)" if algo in map(str.upper, ALGORITHMS) else algo
