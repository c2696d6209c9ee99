"""The rows of a dataset's steps: tables of episodes, and episodes of tables.

An episode of n control steps has n + 1 rows, numbered from 0. Where episodes may end early, the
columns `terminated` and `truncated` are true in the row of the last action, and null, like action
and reward, in that of the last observation.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from jbench.array_types import Float32Array
from jbench.datasets.block import Block

ENDS = ("terminated", "truncated")
"""Columns that say how an episode ended, in tables of tasks whose episodes may end early."""


class Episode(NamedTuple):
    """An episode of n control steps."""

    seed: int
    observations: Float32Array  # (n + 1, dim(O))
    actions: Float32Array  # (n, action_size)
    rewards: Float32Array  # (n,)
    is_terminated: bool  # otherwise it is truncated


def table(
    first_episode: int,
    states: Float32Array,
    made: Float32Array,
    columns: pa.Schema,
) -> pa.Table:
    """Returns the rows of episodes of one length, of which the first has this number.

    Args:
        first_episode: the number.
        states: (episodes, steps + 1, size).
        made: (episodes, steps, size) what follows each state but the last one, where it is null.
        columns: of the table.
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


def ending_table(first_episode: int, episodes: Sequence[Episode], columns: pa.Schema) -> pa.Table:
    """Returns the rows of episodes that may end early, of which the first has this number."""
    parts = [
        _rows(number, episode, columns) for number, episode in enumerate(episodes, first_episode)
    ]
    return pa.concat_tables(parts).combine_chunks()


def _rows(number: int, episode: Episode, columns: pa.Schema) -> pa.Table:
    """Returns the rows of an episode, one for each of its states."""
    length = len(episode.rewards)
    steps = np.arange(length + 1)
    made = np.concatenate([episode.actions, episode.rewards[:, None]], axis=1)
    padded = np.concatenate([made, np.zeros_like(made[:1])])

    is_end = steps == length - 1
    terminated = is_end & episode.is_terminated
    truncated = is_end & (not episode.is_terminated)

    is_last_state = steps == length
    values = [np.full(length + 1, number), steps, *episode.observations.T]
    for column in (*padded.T, terminated, truncated):
        values.append(pa.array(column, mask=is_last_state))

    return pa.table(dict(zip(columns.names, values, strict=True)), schema=columns)


def flaw(
    step_rows: pa.Table, episode_rows: pa.Table, episodes: range, episode_steps: int
) -> str | None:
    """Returns a problem of the rows of whole episodes, to follow "holds"; None if they are valid.

    The episodes have the expected numbers, and `episode_steps` control steps. Those of rows with
    the columns `ENDS` may have fewer.
    """
    step = step_rows["step"].to_numpy()
    if not len(step):
        return "no rows"

    disorder = "other rows than those of whole episodes in their order"
    if step_rows["step"].null_count:
        return disorder

    first = np.flatnonzero(step == 0)
    last = np.append(first[1:], len(step)) - 1
    lengths = np.asarray(step[last], np.int64)
    may_end_early = ENDS[0] in step_rows.column_names
    least = 1 if may_end_early else episode_steps
    if len(first) != len(episodes) or (lengths < least).any() or (lengths > episode_steps).any():
        return disorder

    numbers = np.arange(episodes.start, episodes.stop)
    steps = np.concatenate([np.arange(length + 1) for length in lengths])
    expected = (steps, np.repeat(numbers, lengths + 1), numbers)
    columns = (step_rows["step"], step_rows["episode"], episode_rows["episode"])
    if not all(map(np.array_equal, columns, expected)):
        return disorder

    is_last = np.zeros(len(step), bool)
    is_last[last] = True
    ends = ENDS if may_end_early else ()
    names = [name for name in step_rows.column_names if name not in ends]
    made = _made(names)
    if not all(np.array_equal(step_rows[name].is_null(), is_last) for name in (*made, *ends)):
        return "a state without its action, or an action after the last state"

    if may_end_early:
        counts = sum(step_rows[name].fill_null(False).to_numpy().astype(int) for name in ENDS)
        if not np.array_equal(counts, np.roll(is_last, -1)):
            return "an episode without its end, or an end within one"

    states = step_rows.select(names).drop_columns(made)
    followed = step_rows.select(made).drop_null()
    for table in (states, episode_rows, followed):
        for name, column in zip(table.column_names, table.columns, strict=True):
            if column.null_count:
                return f"empty cells in the column {name}"
            if not np.isfinite(column.to_numpy()).all():
                return f"NaN or infinite values in the column {name}"

    return None


def _made(names: list[str]) -> list[str]:
    """Returns the columns of the action and of its reward, which are the last ones of the steps.

    The Jitterbug's rows have the action alone. A part of an observation may have a name that begins
    with action as well.
    """
    if names[-1] != "reward":
        return names[-1:]
    return names[names.index("action_0") :]


def block(step_rows: pa.Table, observation_size: int) -> Block:
    """Returns the episodes of rows without a `flaw`."""
    step = step_rows["step"].to_numpy()
    first = np.flatnonzero(step == 0)
    lengths = np.diff(np.append(first, len(step))) - 1

    names = [name for name in step_rows.column_names[2:] if name not in ENDS]
    values = np.stack([step_rows[name].fill_null(0).to_numpy() for name in names], axis=-1)
    padded = np.zeros((len(first), lengths.max() + 1, len(names)), np.float32)
    episode = np.repeat(np.arange(len(first)), lengths + 1)
    padded[episode, step] = values

    observations, actions, rewards = np.split(padded, [observation_size, len(names) - 1], axis=-1)
    terminated = np.zeros(len(first), bool)
    if "terminated" in step_rows.column_names:
        is_terminal = step_rows["terminated"].fill_null(False).to_numpy()
        terminated = is_terminal[first + lengths - 1]

    return Block(
        observations=np.ascontiguousarray(observations),
        actions=np.ascontiguousarray(actions[:, :-1]),
        rewards=np.ascontiguousarray(rewards[:, :-1, 0]),
        lengths=lengths,
        terminated=terminated,
    )
