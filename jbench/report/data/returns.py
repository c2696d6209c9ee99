"""The two kinds of return, of evaluations and of training; how numbers, names and texts read."""

import math
from collections.abc import Callable, Iterable

import pandas as pd

from jbench.names import ReturnsName
from jbench.settings.algorithms import ALGORITHMS
from jbench.task_specs import return_range, solved_return

SOLVED = 900  # episode return from which a task of the Jitterbug is solved (paper, Figure 9)
EVALUATION: ReturnsName = "evaluation"  # mean return of episodes with the deterministic policy
TRAINING: ReturnsName = "training"  # return of a training episode, exploration included
KINDS = (EVALUATION, TRAINING)
FILE = "file"  # source of the curves of a file, which may be of any environment
_ZERO = 1e-6
_SMALL = 9.95  # numbers between them have two significant digits


def has_solved_return(tasks: Iterable[str], sources: Iterable[str]) -> bool:
    """Returns whether `SOLVED` counts for all tasks of some configurations and their sources."""
    return FILE not in {*sources} and all(solved_return(task) is not None for task in {*tasks})


def has_return_range(tasks: Iterable[str], sources: Iterable[str]) -> bool:
    """Returns whether the returns of all tasks are from 0 to 1000, whatever was trained."""
    return FILE not in {*sources} and all(return_range(task) is not None for task in {*tasks})


def highest_return(task: str) -> float:
    """Returns the largest possible return of an episode; infinity if it is unknown."""
    known = return_range(task)
    return math.inf if known is None else known[1]


def whole(value: float) -> str:
    """Formats a return; one just below `SOLVED` has a decimal: 899.6 must not read 900."""
    if _ZERO < abs(value) < _SMALL:
        return f"{value:.2g}"
    if SOLVED - 0.5 <= value < SOLVED:
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
    if sign == "-" and SOLVED - 0.5 <= value < SOLVED:  # as by `whole`
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


def display_name(algo: str) -> str:
    """Returns an algorithm's name as the paper writes it, or as its author does.

    The label `TD3` of a recorded or imported algorithm differs from that of jbench's td3.
    """
    if algo in ALGORITHMS:
        return algo.upper()
    return f"{algo} (label)" if algo in map(str.upper, ALGORITHMS) else algo


def clean(text: str) -> str:
    """Returns a text in one line, without characters that control a terminal or the direction."""
    line = " ".join(text.split())
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


def map_texts(frame: pd.DataFrame, change: Callable[[str], str] = str) -> pd.DataFrame:
    """Returns a frame in which each text is clean, and changed by a function."""
    changed = frame.copy(deep=False)
    for name in changed.select_dtypes(["object", "str", "category"]):
        if len(frame) and isinstance(frame[name].iloc[0], dict):
            continue  # of texts by name
        texts = [text for text in frame[name].unique() if isinstance(text, str)]
        if known := {text: new for text in texts if (new := change(clean(text))) != text}:
            changed[name] = frame[name].map(lambda value, known=known: known.get(value, value))
    return changed
