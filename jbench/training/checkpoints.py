"""Checkpoints of a run, from which it resumes bit for bit.

The newest two are kept, and with `--keep-state` the last one after the end of the run. The replay
buffer is stored in pieces: each checkpoint adds one with the new rows, and when there are 32 pieces
they are rewritten as one. A compact one, which a finished run keeps, has no pieces: actions are in
the file of the checkpoint, which older versions refuse by its format.
"""

import json
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
import safetensors
import safetensors.torch
import torch
from pydantic import BaseModel, ValidationError
from torch import Tensor

from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.environments import SeedState
from jbench.agents.trainer import Trainer
from jbench.errors import WorkError
from jbench.settings.base import Settings
from jbench.store import Record
from jbench.store.files import UnreadableError
from jbench.store.roles import CHECKPOINT, checkpoint_role
from jbench.training.compact import CompactHeader, CompactReplay, compacted
from jbench.training.log import Position, RunLog, rows_before

FORMAT = 1
COMPACT_FORMAT = 2

_MAX_PIECES = 32  # of the replay buffer
_PIECE = re.compile(r"replay-(\d+)-(\d+)\.safetensors")
_ENVELOPE = "envelope"
_ROWS = "rows"
_COMPACT_ACTIONS = "compact/actions"
_COMPACT_ROWS = "compact/rows"


class _Envelope(BaseModel):
    model_config = Settings.model_config

    format: int
    run: str
    position: Position
    scalars: dict[str, Any]
    compact: CompactHeader | None = None  # of that format, unless there is no replay buffer


class Checkpoint(NamedTuple):
    """State of an agent and its robots from which a run resumes; `read_replay` reads the buffer.

    `replay_row` is the number after the last row in the replay buffer, 0 without one. If it is not
    the newest checkpoint, the newer ones are damaged. A `compact` replay buffer has no rows to
    read: they are computed again.
    """

    position: Position
    state: SeedState
    replay_row: int
    newest: bool
    compact: CompactReplay | None = None


class _Piece(NamedTuple):
    """Rows `first` to `end` (exclusive) of a replay buffer, counted from the first one ever."""

    first: int
    end: int

    @property
    def role(self) -> str:
        return f"replay-{self.first:012d}-{self.end:012d}.safetensors"


def save(
    record: Record, log: RunLog, trainer: Trainer, index: int, *, only: bool = False
) -> Checkpoint | None:
    """Commits the pending rows of a run and a checkpoint atomically.

    The run has an index in its trainer, which is between two control steps; a trainer without a
    state has no checkpoint. If `only`, all existing checkpoints are dropped.
    """
    state = trainer.state(index)
    if state is None:
        log.commit()
        return None
    roles = record.roles()
    states = [match for role in roles if (match := CHECKPOINT.fullmatch(role))]
    ended = set(roles) if only else {match[0] for match in states[:-1]}  # two are kept
    files: dict[str, bytes] = {}
    row = 0
    if (replay := trainer.replay) is not None:
        row = replay.row
        oldest = replay.oldest
        pieces = [] if only else _pieces(roles)
        # A piece that begins before the oldest row in the buffer stays as it is.
        too_many = len(pieces) >= _MAX_PIECES
        joined = [piece for piece in pieces if too_many and piece.first >= oldest]
        first = joined[0].first if joined else max([oldest, *(other.end for other in pieces)])
        piece = _Piece(first, row)
        rows = replay.rows_since(index, piece.first)
        files[piece.role] = safetensors.torch.save({_ROWS: rows.contiguous()})
        # The previous checkpoint needs rows that are older by the same number.
        behind = row - min((int(match[2]) for match in states[-1:]), default=row)
        ended |= {other.role for other in joined}
        ended |= {other.role for other in pieces if other.end <= oldest - behind}
    position = log.position(trainer.control_steps)
    checkpoint = Checkpoint(position, state, row, newest=True)
    log.commit(files | _state_file(checkpoint, record.id), ended)
    return checkpoint


def compact_files(
    checkpoint: Checkpoint, record: Record, replay: ReplayBuffer, index: int
) -> dict[str, bytes]:
    """Returns the files, by role, of the compact state of a run with an index in its trainer.

    Nothing was added to the replay buffer since the checkpoint, and the rows are committed.
    """
    count = replay.environments
    ends = record.read("episodes")["control_steps"].to_pylist()
    compact = compacted(replay, index, sorted({steps // count for steps in ends}))
    return _state_file(checkpoint._replace(compact=compact), record.id)


def copied(
    checkpoint: Checkpoint, record: Record, longer: str, replay: Tensor | None = None
) -> tuple[dict[str, pa.Table], dict[str, bytes]]:
    """Returns rows by table and checkpoint files by role of a finished run, for a longer one.

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
    files = {piece.role: record.read_file(piece.role) for piece in _pieces(record.roles())}
    if replay is not None:
        piece = _Piece(checkpoint.replay_row - replay.shape[1], checkpoint.replay_row)
        files[piece.role] = safetensors.torch.save({_ROWS: replay.contiguous()})
    return tables, files | _state_file(checkpoint._replace(compact=None), longer)


def newest(record: Record) -> set[str]:
    """Returns the roles of a run's newest checkpoint and of its replay buffer."""
    states = [role for role in record.roles() if CHECKPOINT.fullmatch(role)]
    return {*states[-1:], *(piece.role for piece in _pieces(record.roles()))}


def load(record: Record) -> tuple[Checkpoint | None, list[str]]:
    """Returns the newest intact checkpoint, if any, and a sentence for each that is rejected."""
    refused: list[str] = []
    for role in reversed(record.roles()):
        match = CHECKPOINT.fullmatch(role)
        if match is None:
            continue
        try:
            position, state, compact = _read(record, role)
            # Check the replay pieces now, while an older checkpoint can still be chosen.
            for piece in _pieces(record.roles()):
                if piece.first < int(match[2]):
                    record.read_file(piece.role)
            checkpoint = Checkpoint(position, state, int(match[2]), not refused, compact)
            return checkpoint, refused
        except UnreadableError:
            raise
        except (WorkError, ValueError) as error:
            reason = error.reason if isinstance(error, WorkError) else str(error).rstrip(".")
            refused.append(
                f"The checkpoint of {record.id} at {int(match[1])} control steps is not used: "
                f"{reason}."
            )
    return None, refused


def read_replay(record: Record, row: int) -> Tensor:
    """Returns the saved rows (environments, rows, width) before number `row`, or a WorkError."""
    pieces = [piece for piece in _pieces(record.roles()) if piece.first < row]
    parts = [_tensors(record, piece.role)[_ROWS] for piece in pieces]
    if not parts:
        return torch.zeros(1, 0, 0)
    rows = torch.cat(parts, dim=1)
    return rows[:, : rows.shape[1] - (pieces[-1].end - row)] if pieces[-1].end > row else rows


def _read(record: Record, role: str) -> tuple[Position, SeedState, CompactReplay | None]:
    """Reads a checkpoint; raises a WorkError if its file is damaged, a ValueError if another's."""
    tensors = _tensors(record, role)
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
    position = checkpoint.position
    state = checkpoint.state
    tensors = dict(state.tensors)
    about: dict[str, Any] = {"format": FORMAT}
    if (compact := checkpoint.compact) is not None:
        about = {"format": COMPACT_FORMAT, "compact": compact.header}
        tensors[_COMPACT_ACTIONS] = compact.actions
        tensors[_COMPACT_ROWS] = compact.before
    envelope = _Envelope(run=run, position=position, scalars=state.scalars, **about)
    # Older versions refuse fields that they do not know.
    printed = envelope.model_dump_json(exclude=None if compact else {"compact"})
    tensors[_ENVELOPE] = torch.frombuffer(bytearray(printed.encode()), dtype=torch.uint8)
    role = checkpoint_role(position.control_steps, checkpoint.replay_row)
    return {role: safetensors.torch.save(tensors)}


def _tensors(record: Record, role: str) -> dict[str, Tensor]:
    try:
        return safetensors.torch.load(record.read_file(role))
    except safetensors.SafetensorError as error:
        raise ValueError(f"it is not a safetensors file ({error})") from None


def _pieces(roles: Sequence[str]) -> list[_Piece]:
    matches = [match for role in roles if (match := _PIECE.fullmatch(role))]
    return sorted(_Piece(int(match[1]), int(match[2])) for match in matches)
