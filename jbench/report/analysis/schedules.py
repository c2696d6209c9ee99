"""What is said of two sides that were evaluated at different control steps.

Both are compared up to the last control step that every seed of both has reached. Their last
evaluations before it may be at different steps, and means over the run are then of returns that are
interpolated between evaluations.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.numbers import steps
from jbench.report.analysis.pair import Pair
from jbench.report.data.configuration import Configuration
from jbench.report.data.source_names import FILE
from jbench.returns import EVALUATION
from jbench.studies.quantities import SPEED, Quantity
from jbench.wording import counted

_NEAR = 0.01
"""Last evaluations are at one control step if they differ by this part of it or less."""


def nothing_in_common(pair: Pair) -> str:
    """Returns why a side has no return up to the step at which both are compared; "" if both do."""
    for config, other in (pair.sides, pair.sides[::-1]):
        if not any(len(at) for at, _ in config.points):
            return f"nothing in common, no return of {config.configuration} is a finite number"
        if not _last_steps(config, pair.control_steps):
            first = steps(np.nanmin(config.control_steps))
            return (
                f"nothing in common, the first return of {config.configuration} is at {first} "
                f"control steps, and {other.configuration} ends at {steps(other.last_step)}"
            )

    return ""


def remark_on_schedules(pair: Pair, quantity: Quantity) -> str:
    """Returns a clause on what the schedules of two sides have not in common; "" if they agree.

    Args:
        pair: the sides.
        quantity: the number by which they are compared.
    """
    if apart := nothing_in_common(pair):
        return apart
    if pair.ours.returns_name != EVALUATION:
        return ""

    end = pair.control_steps
    # Of which kind the returns of a file are is not known.
    differ = "logged" if pair.ours.source == FILE else "evaluated"
    differ += " at different control steps"
    if quantity is SPEED:
        means = f"{differ}, so means are of interpolated returns"
        return "" if _are_logged_alike(pair.sides, end) else means

    last = [max(_last_steps(config, end)) for config in pair.sides]
    if abs(last[0] - last[1]) <= _NEAR * end:
        return ""

    return f"{differ}, here at {steps(last[0])} and {steps(last[1])}"


def notes_on_remarks(verdicts: pd.DataFrame, comparisons: pd.DataFrame) -> list[str]:
    """Returns a sentence on the verdicts on sides that were not evaluated alike, if there are any.

    Args:
        verdicts: see `verdict_frame`.
        comparisons: see `comparison_frame`.
    """
    noted = [
        f"{row[first]} against {row[other]}: {row['remark']}"
        for frame, first, other in ((verdicts, "configuration", "against"), (comparisons, "a", "b"))
        for row in frame[frame["remark"] != ""].to_dict("records")
    ]
    if not noted:
        return []

    count = counted(len(noted), "verdict")
    return [f"Sides that were not evaluated alike are compared in {count}, such as {noted[0]}."]


def _last_steps(config: Configuration, control_steps: float) -> set[float]:
    """Returns the last control steps, up to one, at which seeds have a return."""
    logged = (at for at, _ in config.points_up_to(control_steps))
    return {float(at[-1]) for at in logged if len(at)}


def _are_logged_alike(sides: Sequence[Configuration], control_steps: float) -> bool:
    """Returns whether all seeds of sides have returns at the same control steps, up to one."""
    logged = [at for config in sides for at, _ in config.points_up_to(control_steps) if len(at)]
    return all(np.array_equal(at, logged[0]) for at in logged)
