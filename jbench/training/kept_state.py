"""What a finished run keeps of its last checkpoint, from which a longer run can continue."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from jbench.agents.batched.replay import ReplayBuffer
from jbench.names import KeepState
from jbench.store import Record
from jbench.training.checkpoints import Checkpoint, compact_files, newest_roles
from jbench.training.compact import reason_for_whole_state


class KeptState(NamedTuple):
    """The state that a finished run keeps.

    Attributes:
        roles: of the files of its record that stay.
        files: new ones, by role.
        reason: why the replay buffer is kept as rows and not as actions, as was asked; None if it
            is kept as asked.
    """

    roles: Collection[str] = ()
    files: Mapping[str, bytes] = {}
    reason: str | None = None


def kept_state(
    keep: KeepState,
    record: Record,
    checkpoint: Checkpoint | None,
    replay: ReplayBuffer | None,
    index: int,
) -> KeptState:
    """Returns what a run keeps of its state, which is that of its last checkpoint.

    Args:
        keep: what was asked for.
        record: of the run.
        checkpoint: its last one; None if it has no state.
        replay: the replay buffers of the engine, if there are any.
        index: of the run in the engine.
    """
    if keep == "no":
        return KeptState()
    if keep == "whole" or replay is None or checkpoint is None:
        return KeptState(newest_roles(record))

    reason = reason_for_whole_state(record)
    if reason is not None:
        return KeptState(newest_roles(record), reason=reason)
    return KeptState(files=compact_files(checkpoint, record, replay, index))
