"""Columns that several tables of a report have."""

from jbench.report.data.returns import steps
from jbench.report.table import Column, FrameRow, number, plain

INTERVAL = "In brackets: 95% interval."
"""What the captions of tables with intervals say."""


def _range(row: FrameRow) -> str:
    """Returns the control steps of the shortest and the longest run, once if they are equal."""
    return "\N{EN DASH}".join(dict.fromkeys((steps(row["steps_min"]), steps(row["steps"]))))


TASK = plain("task")
ALGO = plain("algorithm", "algo")
OBSERVED = Column(
    "representation",
    "representation",
    lambda row: ", ".join(filter(None, (row["representation"], row["words"]))),
)
SEEDS = number("seeds", "seeds", str)
RANGE = Column("steps", "steps", _range, numeric=True)
