"""Replay buffers that are kept as actions: what is kept, and the rows computed again from it.

A row follows from the seed of a run and the actions in its episode, so a compact state has a number
for each action instead of a row of the buffer. The initial states of episodes are drawn again from
the seed.
"""

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.replay import ReplayBuffer
from jbench.encoders import Encoder
from jbench.errors import RequestError
from jbench.settings.base import Settings
from jbench.settings.run import RunSettings
from jbench.store import Record
from jbench.store.provenance import describe_changes, differences, process_provenance
from jbench.training.engines import make_engine

RECOMPUTED = "recomputed"
"""Key of a note on where a run was continued: the rows that were computed again, and equal."""

_WITHOUT_EFFECT = {"git_revision", "threads", "device", "gpu", "cuda", "driver"}
"""Changes of provenance that leave the rows of a replay buffer as they are."""


class OtherRowsError(RequestError):
    """A replay buffer that was computed again differs from that of the run."""


class CompactHeader(Settings):
    """What a compact replay buffer has beside its tensors.

    Attributes:
        episodes: number of episodes of each environment before the first repeated one.
        row: number of the first row of that episode.
        sha256: checksum of all rows of the buffer.
    """

    episodes: int = Field(ge=0)
    row: int = Field(ge=0)
    sha256: str


class CompactReplay(NamedTuple):
    """The replay buffer of one seed.

    Rows of an episode whose beginning has expired can't be computed again, so they are kept.

    Attributes:
        actions: (steps, environments, action_size) of the agent since the first whole episode.
        before: (environments, rows, width), the rows before that episode.
    """

    header: CompactHeader
    actions: Tensor
    before: Tensor


def compacted(replay: ReplayBuffer, seed: int, ends: Sequence[int]) -> CompactReplay:
    """Returns the replay buffer of a seed without the rows that follow from its actions.

    `ends` are the transitions of each environment after which an episode ended, in order.
    """
    rows = replay.rows_since(seed)
    oldest = replay.row - rows.shape[1]
    begun = [replay.row_number(transition) for transition in (0, *ends)]
    whole = [row for row in begun if row >= oldest]
    if whole:
        first = whole[0]
        episodes = len(begun) - len(whole)
    else:  # no episode has begun since the oldest row: all rows are kept
        first = replay.row
        episodes = 0

    has_action = replay.has_action(torch.arange(first, replay.row))
    actions = rows[:, first - oldest :, replay.action_columns][:, has_action]
    header = CompactHeader(episodes=episodes, row=first, sha256=_checksum(rows))
    return CompactReplay(
        header,
        actions.transpose(0, 1).contiguous(),
        rows[:, : first - oldest].contiguous(),
    )


def computed_again(
    runs: Sequence[RunSettings],
    encoders: Sequence[Encoder | None],
    kept: Sequence[CompactReplay],
    device: str,
) -> list[Tensor | None]:
    """Returns the rows (environments, rows, width) of each replay buffer, or None if they differ.

    All of them begin at the same row and have as many actions; see `can_share`.
    """
    header = kept[0].header
    with make_engine(runs, encoders, device) as engine:
        assert isinstance(engine, OffPolicyEngine)
        engine.repeat(
            header.episodes,
            [replay.before for replay in kept],
            header.row,
            torch.stack([replay.actions for replay in kept], dim=1).numpy(),
        )
        rows = [engine.replay.rows_since(seed) for seed in range(len(kept))]
    same: list[Tensor | None] = [*rows]
    for index, replay in enumerate(kept):
        if _checksum(rows[index]) != replay.header.sha256:
            same[index] = None

    return same


def can_share(one: CompactReplay, other: CompactReplay) -> bool:
    """Returns whether two replay buffers can be computed again side by side."""
    shapes = one.actions.shape, one.before.shape
    if shapes != (other.actions.shape, other.before.shape):
        return False
    return (one.header.episodes, one.header.row) == (other.header.episodes, other.header.row)


def other_rows_error(record: Record) -> OtherRowsError:
    """Returns the error of a run whose replay buffer is another one when it is computed again."""
    made = record.manifest.provenance
    changed = differences(made, process_provenance())
    for name in _WITHOUT_EFFECT:
        changed.pop(name, None)
    why = "its file may have been altered, since machine and versions are the same"
    if changed:
        why = describe_changes(changed)
    return OtherRowsError(
        f"The compact state of {record.id} can't be continued: its replay buffer, computed again "
        f"from its actions, is not the one of the run ({why}); type the command on a machine like "
        f"the one that made it ({made.get('processor', 'unknown')}), or with another --results, "
        "where the run trains from the beginning."
    )


def reason_for_whole_state(record: Record) -> str | None:
    """Returns why the rows of a run may not follow from its actions on this machine, or None."""
    before = dict[str, object]()
    for note in record.manifest.provenance.get("continued", []):
        changed = {
            name: change for name, change in note["changed"].items() if name not in _WITHOUT_EFFECT
        }
        if RECOMPUTED in note:
            before = changed
        elif changed != before:
            return f"it was resumed where {describe_changes(changed) or 'it had begun'}"
        if "truncated" in note:
            return "an episode did not repeat"
    return None


def _checksum(rows: Tensor) -> str:
    """Returns the SHA-256 of the numbers of rows."""
    return hashlib.sha256(rows.contiguous().numpy().data).hexdigest()
