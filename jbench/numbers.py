"""How numbers read: returns, differences of returns, ratios and control steps."""

import math
from collections.abc import Callable, Sequence

from jbench.task_specs import SOLVED_RETURN

Form = Callable[[float], str]

_ZERO = 1e-6
_SMALL = 9.95
"""Numbers between them have two significant digits."""

_LARGE = 1e12
"""Numbers from it on have three, and an exponent."""


def whole(value: float) -> str:
    """Formats a return; one just below `SOLVED_RETURN` has a decimal: 899.6 must not read 900."""
    if _ZERO < abs(value) < _SMALL:
        return f"{value:.2g}"
    if _LARGE <= abs(value) < math.inf:
        return f"{value:.3g}"
    if SOLVED_RETURN - 0.5 <= value < SOLVED_RETURN:
        return f"{math.floor(10 * value) / 10:,}"
    return f"{round(value):,d}" if math.isfinite(value) else fixed(value, 0)


def one_decimal(value: float) -> str:
    """Formats the return of an episode, which is no estimate: with a decimal, as 672.4."""
    return f"{value:.1f}" if 1 <= abs(value) < _LARGE else whole(value)


def signed(value: float) -> str:
    """Formats a difference of returns."""
    if not math.isfinite(value):
        return fixed(value, 0, "+")
    if _ZERO < abs(value) < _SMALL:
        return f"{value:+.2g}"
    if abs(value) >= _LARGE:
        return f"{value:+.3g}"
    return f"{round(value):+,d}" if abs(value) > _ZERO else "0"


def decimals(form: Form, numbers: Sequence[float]) -> int:
    """Returns how many decimals numbers have that stand beside each other.

    They are as many as two significant digits of the largest one need: none from 10 on. A return
    just below `SOLVED_RETURN` has one.
    """
    largest = max((abs(number) for number in numbers if math.isfinite(number)), default=0.0)
    if form is whole and any(SOLVED_RETURN - 0.5 <= number < SOLVED_RETURN for number in numbers):
        return 1
    if not _ZERO < largest < _SMALL:
        return 0

    _, _, exponent = f"{largest:.1e}".partition("e")
    return max(1 - int(exponent), 0)


def fixed(value: float, places: int, sign: str = "-") -> str:
    """Formats a return with a number of decimals, and a difference with the sign "+"."""
    if not math.isfinite(value):
        return f"{value:{sign}}".replace("inf", "infinite")
    if abs(value) >= _LARGE:
        return f"{value:{sign}.3g}"
    if sign == "-" and SOLVED_RETURN - 0.5 <= value < SOLVED_RETURN:  # as by `whole`
        value = math.floor(value * 10**places) / 10**places
    text = f"{value:{sign}z,.{places}f}"
    return text if text.strip("+0.") else text.lstrip("+")


def end(value: float, places: int, sign: str = "-") -> str:
    """Formats the end of an interval.

    Where that of a difference is so small that it reads 0, a sign shows on which side of 0 it is:
    `[+0, +61]` does not contain 0, and `[0, +61]` begins there.
    """
    text = fixed(value, places, sign)
    reads_zero = not text.strip("0.")
    if sign == "+" and reads_zero and abs(value) > _ZERO:
        return f"{'-' if value < 0 else '+'}{text}"

    return text


def texts(
    form: Form, value: float, ends: Sequence[float], places: int | None = None
) -> tuple[str, str]:
    """Formats a number, and its interval such as `[640, 690]`, all with as many decimals.

    Args:
        form: of a single number; only `whole` and `signed` have different numbers of decimals.
        value: the number.
        ends: of its interval; none if it is unknown.
        places: decimals, if other numbers beside these need more.
    """
    sign = SIGNS.get(form)
    if sign is None or (places is None and not ends):
        return form(value), f"[{', '.join(map(form, ends))}]" if ends else ""

    if places is None:
        places = decimals(form, (value, *ends))

    interval = ", ".join(end(number, places, sign) for number in ends)
    return fixed(value, places, sign), f"[{interval}]" if interval else ""


def with_interval(form: Form, value: float, ends: Sequence[float]) -> str:
    """Formats a number with its interval, if that is known: `668 [640, 690]`."""
    return " ".join(filter(None, texts(form, value, ends)))


def with_error(value: float, error: float) -> str:
    """Formats a return with its error, if that is known: `668 ± 12`."""
    if not math.isfinite(error):
        return whole(value)

    places = decimals(whole, (value, error))
    return f"{fixed(value, places)} ± {fixed(error, places)}"


def ratio(value: float) -> str:
    """Formats a ratio or a probability; one that rounds to zero has no sign."""
    return f"{value:z.2f}"


def steps(value: float) -> str:
    """Formats control steps in the unit that fits: `500`, `22.5k`, `300k`, `1M`."""
    if math.isinf(value):
        return "later"
    # Rounded first, so that 999,900 becomes 1M instead of 1e+03k.
    rounded = float(f"{value:.3g}")
    for size, unit in ((1e6, "M"), (1e3, "k")):
        if rounded >= size:
            return f"{rounded / size:g}{unit}"
    return f"{rounded:g}"


SIGNS: dict[Form, str] = {whole: "-", signed: "+"}
"""Of the forms whose numbers have different decimals."""
