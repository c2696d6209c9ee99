"""The columns of datasets.

Those of the Jitterbug have states and actions, and per episode the targets of every task. Those of
another robot have its observations, actions and rewards, and per episode its seed.
"""

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.datasets.ending import ENDS
from jbench.settings.records import JITTERBUG
from jbench.store import Record
from jbench.store.schema import STATE_COLUMNS, STEPS
from jbench.tasks.jitterbug.geometry import TARGET_HEIGHT, State, Target
from jbench.tasks.task import Task

Float = NDArray[np.float32]

SEEDS = pa.schema([("episode", pa.int32()), ("seed", pa.int64())])
"""Episodes of a dataset of another robot: the seed from which each begins."""


def tables(robot: str) -> tuple[str, str]:
    """Returns the names of the tables of a robot's datasets: of the steps, and of the episodes."""
    return ("steps", "dataset_episodes") if robot == JITTERBUG else ("observations", "seeds")


def control_steps(record: Record) -> int:
    """Returns the control steps of the committed episodes of a dataset."""
    steps, episodes = tables(record.settings.get("robot", JITTERBUG))
    return record.rows(steps) - record.rows(episodes)  # an episode has one row more than steps


def observations_schema(task: Task) -> pa.Schema:
    """Returns the columns of the steps of another robot: an action and its reward are null last.

    Those of a task whose episodes may end early say how they ended.
    """
    names = [*task.labels, *task.action_labels, "reward"]
    counts = [("episode", pa.int32()), ("step", pa.int16())]
    ends = [(name, pa.bool_()) for name in ENDS] if task.ends_early else []
    return pa.schema([*counts, *((name, pa.float32()) for name in names), *ends])


def steps_table(first_episode: int, state: State, actions: Float) -> pa.Table:
    """Returns the rows of episodes: states (episodes, steps + 1), actions (episodes, steps)."""
    parts = (
        np.reshape(getattr(state, part), (*state.motor_position.shape, len(names)))
        for part, names in STATE_COLUMNS.items()
    )
    states = np.concatenate([part.astype(np.float32) for part in parts], axis=-1)
    return table(first_episode, states, actions[..., None], STEPS)


def table(first_episode: int, states: Float, made: Float, columns: pa.Schema) -> pa.Table:
    """Returns rows of states (episodes, steps + 1, size) and what follows (episodes, steps, size).

    The latter is null in the last state of an episode.
    """
    episodes, steps, _ = made.shape
    step = np.tile(np.arange(steps + 1), episodes)
    padded = np.concatenate([made, np.zeros_like(made[:, :1])], axis=1)
    values = [
        np.repeat(np.arange(first_episode, first_episode + episodes), steps + 1),
        step,
        *states.reshape(len(step), states.shape[-1]).T,
        *(
            pa.array(column, mask=step == steps)
            for column in padded.reshape(len(step), padded.shape[-1]).T
        ),
    ]
    return pa.table(dict(zip(columns.names, values, strict=True)), schema=columns)


def flaw(steps: pa.Table, targets: pa.Table, episodes: range, episode_steps: int) -> str | None:
    """Returns a problem of the rows of whole episodes, to follow "holds"; None if they are valid.

    The episodes have the expected numbers; the rows are of `STEPS` or `observations_schema`, and of
    `DATASET_EPISODES` or `SEEDS`.
    """
    made = [name for name in steps.column_names if name.startswith("action") or name == "reward"]
    numbers = np.arange(episodes.start, episodes.stop)
    step_numbers = np.arange(episode_steps + 1)
    expected = (np.repeat(numbers, len(step_numbers)), np.tile(step_numbers, len(numbers)), numbers)
    columns = (steps["episode"], steps["step"], targets["episode"])
    if not all(map(np.array_equal, columns, expected)):
        return "other rows than those of whole episodes in their order"

    last = expected[1] == episode_steps
    if not all(np.array_equal(steps[name].is_null(), last) for name in made):
        return "a state without its action, or an action after the last state"

    for table in (steps.drop_columns(made), targets, steps.select(made).drop_null()):
        for name, column in zip(table.column_names, table.columns, strict=True):
            if column.null_count:
                return f"empty cells in the column {name}"
            if not np.isfinite(column.to_numpy()).all():
                return "NaN or infinite values"

    return None


def read_state(rows: pa.Table, episode_steps: int) -> State:
    """Returns the states (episodes, steps + 1) of rows of whole episodes, in float32."""
    parts = {}
    for part, names in STATE_COLUMNS.items():
        columns = [rows[name].to_numpy().reshape(-1, episode_steps + 1) for name in names]
        parts[part] = np.stack(columns, -1) if len(names) > 1 else columns[0]
    return State(**parts)


def read_target(task: str, rows: pa.Table, states: int) -> Target:
    """Returns the targets (episodes, states) of a task, in float32."""
    x, y, yaw = (
        np.broadcast_to(column.to_numpy().astype(np.float32)[:, None], (len(rows), states))
        for column in (rows[f"{task}_target_{part}"] for part in ("x", "y", "yaw"))
    )
    return Target(np.stack([x, y, np.full_like(x, TARGET_HEIGHT)], -1), yaw)
