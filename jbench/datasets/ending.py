"""Datasets of robots whose episodes may end early: their rows, and blocks of their episodes.

An episode of n control steps has n + 1 rows, numbered from 0. The columns `terminated` and
`truncated` are true in the row of its last action, and null, like action and reward, in that of its
last observation.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

Float = NDArray[np.float32]

ENDS = ("terminated", "truncated")
"""Columns that say how an episode ended."""


class Episode(NamedTuple):
    """An episode of n control steps."""

    seed: int
    observations: Float  # (n + 1, dim(O))
    actions: Float  # (n, action_size)
    rewards: Float  # (n,)
    is_terminated: bool  # otherwise it is truncated


class EndingBlock(NamedTuple):
    """Episodes of different lengths, up to n control steps; what is after an end is 0.

    Attributes:
        observations: (episodes, n + 1, dim(O)) in float32.
        actions: (episodes, n, action_size) in float32.
        rewards: (episodes, n) in float32.
        lengths: (episodes,) control steps of each.
        terminated: (episodes,) whether an episode terminated; otherwise it was truncated.
    """

    observations: Float
    actions: Float
    rewards: Float
    lengths: NDArray[np.int64]
    terminated: NDArray[np.bool_]

    @property
    def states(self) -> Float:
        """The observations (rows, dim(O)) of all episodes, one after another."""
        return self.observations[self._is_state]

    @property
    def followed(self) -> NDArray[np.int64]:
        """The number of observations that follow each of `states` in its episode, (rows,)."""
        steps = np.arange(self.observations.shape[1])
        return (self.lengths[:, None] - steps)[self._is_state]

    def in_a_row(self) -> tuple[Float, Float, Float, NDArray[np.int64]]:
        """Returns `states`, the action and reward of each, and `followed`, all (rows, ...).

        Action and reward are 0 in the last state of an episode.
        """
        actions, rewards = (
            np.concatenate([made, np.zeros_like(made[:, :1])], axis=1)[self._is_state]
            for made in (self.actions, self.rewards)
        )
        return self.states, actions, rewards, self.followed

    @property
    def _is_state(self) -> NDArray[np.bool_]:
        """Which steps of the observations are states of an episode, (episodes, steps)."""
        steps = np.arange(self.observations.shape[1])
        return np.asarray(steps <= self.lengths[:, None])


def table(first_episode: int, episodes: Sequence[Episode], columns: pa.Schema) -> pa.Table:
    """Returns the rows of episodes, of which the first has this number."""
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
    ends = is_end & episode.is_terminated, is_end & (not episode.is_terminated)
    values = [
        np.full(length + 1, number),
        steps,
        *episode.observations.T,
        *(pa.array(column, mask=steps == length) for column in (*padded.T, *ends)),
    ]
    return pa.table(dict(zip(columns.names, values, strict=True)), schema=columns)


def flaw(steps: pa.Table, seeds: pa.Table, episodes: range, longest: int) -> str | None:
    """Returns a problem of the rows of whole episodes, to follow "holds"; None if they are valid.

    The episodes have the expected numbers, and at most `longest` control steps.
    """
    step = steps["step"].to_numpy()
    if not len(step):
        return "no rows"

    first = np.flatnonzero(step == 0)
    last = np.append(first[1:], len(step)) - 1
    lengths = np.asarray(step[last], np.int64)
    numbers = np.arange(episodes.start, episodes.stop)

    is_whole = len(first) == len(numbers) and np.array_equal(
        step, np.concatenate([np.arange(length + 1) for length in lengths])
    )
    if (
        not is_whole
        or not np.array_equal(steps["episode"], np.repeat(numbers, lengths + 1))
        or not np.array_equal(seeds["episode"], numbers)
        or (lengths < 1).any()
        or (lengths > longest).any()
    ):
        return "other rows than those of whole episodes in their order"

    is_last = np.zeros(len(step), bool)
    is_last[last] = True
    made = [name for name in steps.column_names if name.startswith("action") or name == "reward"]
    if not all(np.array_equal(steps[name].is_null(), is_last) for name in (*made, *ENDS)):
        return "a state without its action, or an action after the last state"

    ends = sum(steps[name].fill_null(False).to_numpy().astype(int) for name in ENDS)
    if not np.array_equal(ends, np.roll(is_last, -1)):
        return "an episode without its end, or an end within one"

    for name in (name for name in steps.column_names if name not in ENDS):
        values = steps[name].drop_null()
        if name not in made and len(values) < len(step):
            return f"empty cells in the column {name}"
        if not np.isfinite(values.to_numpy()).all():
            return f"NaN or infinite values in the column {name}"

    return None


def block(steps: pa.Table, observation_size: int) -> EndingBlock:
    """Returns the episodes of rows without a `flaw`."""
    step = steps["step"].to_numpy()
    first = np.flatnonzero(step == 0)
    lengths = np.diff(np.append(first, len(step))) - 1

    names = [name for name in steps.column_names[2:] if name not in ENDS]
    values = np.stack([steps[name].fill_null(0).to_numpy() for name in names], axis=-1)
    padded = np.zeros((len(first), lengths.max() + 1, len(names)), np.float32)
    episode = np.repeat(np.arange(len(first)), lengths + 1)
    padded[episode, step] = values

    observations, actions, rewards = np.split(padded, [observation_size, len(names) - 1], axis=-1)
    terminated = steps["terminated"].fill_null(False).to_numpy()
    return EndingBlock(
        np.ascontiguousarray(observations),
        np.ascontiguousarray(actions[:, :-1]),
        np.ascontiguousarray(rewards[:, :-1, 0]),
        lengths,
        terminated[first + lengths - 1],
    )
