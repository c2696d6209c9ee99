"""Checkpoints of a run, from which it resumes bit for bit.

The newest two are kept, and with `--keep-state` the last one after the end of the run. The rows of
the replay buffer are in files of their own (`replay_pieces.py`). A compact checkpoint, which a
finished run keeps, has no such files: its actions are in the file of the checkpoint, which older
versions refuse by its format.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
import safetensors
import safetensors.torch
import torch
from pydantic import BaseModel, ValidationError
from torch import Tensor

from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.engine import Engine
from jbench.agents.environments import SeedState
from jbench.errors import WorkError
from jbench.settings.base import Settings
from jbench.store import Record
from jbench.store.files import UnreadableError
from jbench.store.roles import CHECKPOINT, checkpoint_role
from jbench.training.compact import CompactHeader, CompactReplay, compacted
from jbench.training.log import Position, RunLog, rows_before
from jbench.training.replay_pieces import (
    Piece,
    first_piece,
    next_piece,
    piece_file,
    pieces_among,
    read_tensors,
)

FORMAT = 1
COMPACT_FORMAT = 2

_ENVELOPE = "envelope"
_COMPACT_ACTIONS = "compact/actions"
_COMPACT_ROWS = "compact/rows"


class _Envelope(BaseModel):
    """What a checkpoint has beside its tensors, as JSON."""

    model_config = Settings.model_config

    format: int
    run: str
    position: Position
    scalars: dict[str, Any]
    compact: CompactHeader | None = None  # of that format, unless there is no replay buffer


class Checkpoint(NamedTuple):
    """State of an agent and its robots from which a run resumes.

    The rows of its replay buffer are read by `replay_pieces.stored_rows`.

    Attributes:
        position: where the run is.
        state: of agent and robots.
        replay_row: number after the last row in the replay buffer; 0 without one.
        is_newest: whether no newer checkpoint of the record is damaged.
        compact: a replay buffer without rows to read, since they are computed again.
    """

    position: Position
    state: SeedState
    replay_row: int
    is_newest: bool
    compact: CompactReplay | None = None


class CopiedState(NamedTuple):
    """Rows of a finished run by table, and checkpoint files by role, for the record of another."""

    tables: Mapping[str, pa.Table]
    files: Mapping[str, bytes]


def save(
    record: Record, log: RunLog, engine: Engine, index: int, *, drop_others: bool = False
) -> Checkpoint | None:
    """Commits the pending rows of a run and a checkpoint atomically.

    The run has an index in its engine, which is between two control steps; an engine without a
    state has no checkpoint. Of the existing checkpoints, one is kept, or none if `drop_others`.
    """
    state = engine.state(index)
    if state is None:
        log.commit()
        return None

    roles = record.roles()
    states = [role for role in roles if CHECKPOINT.fullmatch(role)]
    ended = set(states[:-1])
    if drop_others:
        ended = set(roles)

    files: dict[str, bytes] = {}
    replay_row = 0
    replay = engine.replay
    if replay is not None:
        replay_row = replay.row
        if drop_others:
            piece = first_piece(replay, index)
        else:
            piece = next_piece(replay, index, roles)

        files |= piece.files
        ended |= set(piece.ended)

    position = log.position(engine.control_steps)
    checkpoint = Checkpoint(position, state, replay_row, is_newest=True)
    log.commit(files | _state_file(checkpoint, record.id), ended)
    return checkpoint


def compact_files(
    checkpoint: Checkpoint, record: Record, replay: ReplayBuffer, index: int
) -> dict[str, bytes]:
    """Returns the files, by role, of the compact state of a run with an index in its engine.

    Nothing was added to the replay buffer since the checkpoint, and the rows are committed.
    """
    count = replay.environments
    ends = record.read("episodes")["control_steps"].to_pylist()
    compact = compacted(replay, index, sorted({steps // count for steps in ends}))
    return _state_file(checkpoint._replace(compact=compact), record.id)


def copied(
    checkpoint: Checkpoint, record: Record, longer: str, replay: Tensor | None = None
) -> CopiedState:
    """Returns the rows and the state of a finished run at a checkpoint, for a longer run.

    The checkpoint is from `load`, and `replay` are the rows of a compact one, computed again. The
    last evaluation of a finished run may have more episodes than the others. Raises an
    UnreadableError if a file can't be read now, a WorkError if one is damaged.
    """
    tables = rows_before(record, checkpoint.position)
    regular = pc.field("episode") < record.settings["evaluate_episodes"]
    tables["evaluations"] = tables["evaluations"].filter(regular)
    for name, rows in tables.items():
        column = rows.schema.get_field_index("run")
        run = pa.repeat(longer, rows.num_rows)
        tables[name] = rows.set_column(column, rows.schema.field(column), run)

    pieces = pieces_among(record.roles())
    files = {piece.role: record.read_file(piece.role) for piece in pieces}
    if replay is not None:
        piece = Piece(checkpoint.replay_row - replay.shape[1], checkpoint.replay_row)
        files |= piece_file(piece, replay)

    files |= _state_file(checkpoint._replace(compact=None), longer)
    return CopiedState(tables, files)


def newest_roles(record: Record) -> set[str]:
    """Returns the roles of a run's newest checkpoint and of its replay buffer."""
    states = [role for role in record.roles() if CHECKPOINT.fullmatch(role)]
    return {*states[-1:], *(piece.role for piece in pieces_among(record.roles()))}


def load(record: Record) -> tuple[Checkpoint | None, list[str]]:
    """Returns the newest intact checkpoint, if any, and a sentence for each that is rejected."""
    refused: list[str] = []
    for role in reversed(record.roles()):
        match = CHECKPOINT.fullmatch(role)
        if match is None:
            continue

        replay_row = int(match[2])
        try:
            position, state, compact = _read(record, role)
            _check_pieces(record, replay_row)
        except UnreadableError:
            raise
        except (WorkError, ValueError) as error:
            reason = error.reason if isinstance(error, WorkError) else str(error).rstrip(".")
            refused.append(
                f"The checkpoint of {record.id} at {int(match[1])} control steps is not used: "
                f"{reason}."
            )
        else:
            return Checkpoint(position, state, replay_row, not refused, compact), refused
    return None, refused


def _check_pieces(record: Record, replay_row: int) -> None:
    """Raises as `Record.read_file` if the rows before a row of the replay buffer can't be read.

    Checked before the checkpoint is chosen, while an older one can still be taken instead.
    """
    for piece in pieces_among(record.roles()):
        if piece.first < replay_row:
            record.read_file(piece.role)


def _read(record: Record, role: str) -> tuple[Position, SeedState, CompactReplay | None]:
    """Reads a checkpoint; raises a WorkError if its file is damaged, a ValueError if another's."""
    tensors = read_tensors(record, role)
    try:
        header = json.loads(bytes(tensors.pop(_ENVELOPE).numpy()))
        if header["format"] not in (FORMAT, COMPACT_FORMAT):
            readable = f"{FORMAT} and {COMPACT_FORMAT}"
            raise ValueError(f"it has format {header['format']}, but this jbench reads {readable}")
        envelope = _Envelope.model_validate(header)
    except (KeyError, TypeError, ValidationError) as error:
        raise ValueError(f"its header is invalid ({str(error).splitlines()[0]})") from None

    if envelope.run != record.id:
        raise ValueError(f"it belongs to {envelope.run}")

    compact = None
    if envelope.compact is not None:
        actions = tensors.pop(_COMPACT_ACTIONS)
        rows = tensors.pop(_COMPACT_ROWS)
        compact = CompactReplay(envelope.compact, actions, rows)

    return envelope.position, SeedState(tensors, envelope.scalars), compact


def _state_file(checkpoint: Checkpoint, run: str) -> dict[str, bytes]:
    """Returns the file of a checkpoint of a run, by its role."""
    position = checkpoint.position
    state = checkpoint.state
    tensors = dict(state.tensors)
    about: dict[str, Any] = {"format": FORMAT}
    left_out: set[str] | None = {"compact"}  # older versions refuse fields that they do not know
    compact = checkpoint.compact
    if compact is not None:
        about = {"format": COMPACT_FORMAT, "compact": compact.header}
        left_out = None
        tensors[_COMPACT_ACTIONS] = compact.actions
        tensors[_COMPACT_ROWS] = compact.before

    envelope = _Envelope(run=run, position=position, scalars=state.scalars, **about)
    printed = envelope.model_dump_json(exclude=left_out)
    tensors[_ENVELOPE] = torch.frombuffer(bytearray(printed.encode()), dtype=torch.uint8)
    role = checkpoint_role(position.control_steps, checkpoint.replay_row)
    return {role: safetensors.torch.save(tensors)}
