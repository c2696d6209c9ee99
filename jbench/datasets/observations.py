"""The tables of datasets of other robots, whose episodes have one length or end early."""

import numpy as np
import pyarrow as pa

from jbench.datasets.rows import ENDS
from jbench.tasks.task import Task

STEP_TABLE = "observations"
"""Name of the table of observations, actions and rewards."""

EPISODE_TABLE = "seeds"
"""Name of the table with a row for each episode."""

EPISODE_COLUMNS = pa.schema([("episode", pa.int32()), ("seed", pa.int64())])
"""Columns of that table: the seed from which each episode begins."""


def observations_schema(task: Task) -> pa.Schema:
    """Returns the columns of the steps; an action and its reward are null in the last state.

    Those of a task whose episodes may end early say how they ended.
    """
    names = [*task.labels, *task.action_labels, "reward"]
    is_short = task.episode_steps <= np.iinfo(np.int16).max
    counts = [("episode", pa.int32()), ("step", pa.int16() if is_short else pa.int32())]
    ends = [(name, pa.bool_()) for name in ENDS] if task.ends_early else []
    return pa.schema([*counts, *((name, pa.float32()) for name in names), *ends])
