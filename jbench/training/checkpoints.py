"""Checkpoints of a run on the batched engine: from any of them it goes on bit for bit.

A checkpoint is committed with the rows that were written before it, and the newest two are kept.
The rows of the replay buffer lie in pieces beside them: a checkpoint adds the new ones, and pieces
of a size are joined sixteen at a time, so that a row is written about three times in a million
steps, and a run has some dozens of files.
"""

import json
import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import safetensors
import safetensors.torch
import torch
from pydantic import BaseModel, ValidationError
from torch import Tensor

from jbench.agents.batched.engine import Engine, SeedState
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.errors import WorkError
from jbench.settings.base import Settings
from jbench.store import Record
from jbench.store.files import UnreadableError
from jbench.training.log import Position, RunLog

FORMAT = 1
"""Of checkpoints; raised when their content changes its meaning."""

_KEPT = 2
_JOINED = 16  # pieces of a size that become one
_SMALLEST = 1000  # rows: pieces of up to 16 times as many are of the first size
_STATE = re.compile(r"checkpoint-(\d+)-(\d+)\.safetensors")
_PIECE = re.compile(r"replay-(\d+)-(\d+)\.safetensors")
_ENVELOPE, _ROWS = "envelope", "rows"


class _Envelope(BaseModel):
    """What a checkpoint says of itself."""

    model_config = Settings.model_config

    format: int
    run: str
    position: Position
    scalars: dict[str, Any]


class Checkpoint(NamedTuple):
    """What a run goes on from; the rows of its replay buffer are read with `read_replay`.

    Attributes:
        position: how far the run is.
        state: of its agent and its robots.
        replay_row: number of the row that follows those of the replay buffer; 0 for PPO.
        newest: whether there is no newer one, which would then be damaged.
    """

    position: Position
    state: SeedState
    replay_row: int
    newest: bool


class _Piece(NamedTuple):
    """Rows `first` to `end`, excluded, of a replay buffer, counted from the first one ever."""

    first: int
    end: int

    @property
    def role(self) -> str:
        return f"replay-{self.first:012d}-{self.end:012d}.safetensors"

    @property
    def size(self) -> int:
        """The power of 16 that it belongs to."""
        return max(0, int(math.log(max(self.end - self.first, 1) / _SMALLEST, _JOINED)))


def save(
    record: Record, log: RunLog, engine: Engine, place: int, *, only: bool = False
) -> Checkpoint:
    """Commits the rows of a run that wait, and a checkpoint, all or nothing.

    Args:
        record: of the run.
        log: of the run.
        engine: that the run goes on in, between two control steps.
        place: of the run in the engine.
        only: whether the checkpoints that are there don't count any more.

    Returns:
        The checkpoint.
    """
    roles = record.roles()
    states = [match for role in roles if (match := _STATE.fullmatch(role))]
    ended = set(roles) if only else {match[0] for match in states[: 1 - _KEPT or None]}
    files: dict[str, bytes] = {}
    row = 0
    if isinstance(engine, OffPolicyEngine):
        row = engine.replay.row
        pieces = [] if only else _pieces(roles)
        piece, joined = _next_piece(pieces, engine.replay.oldest, row)
        rows = engine.replay_rows(place, piece.first)
        files[piece.role] = safetensors.torch.save({_ROWS: rows.contiguous()})
        # The checkpoint before this one needs rows that are as much older.
        behind = row - min((int(match[2]) for match in states[-1:]), default=row)
        ended |= {other.role for other in joined}
        ended |= {other.role for other in pieces if other.end <= engine.replay.oldest - behind}
    state, position = engine.state(place), log.position(engine.control_steps)
    envelope = _Envelope(format=FORMAT, run=record.id, position=position, scalars=state.scalars)
    role = f"checkpoint-{position.control_steps:012d}-{row:012d}.safetensors"
    said = torch.frombuffer(bytearray(envelope.model_dump_json().encode()), dtype=torch.uint8)
    files[role] = safetensors.torch.save({**state.tensors, _ENVELOPE: said})
    tables, replace = log.waiting()
    record.append(tables, files, drop=ended, replace=replace)
    log.committed()
    return Checkpoint(position, state, row, newest=True)


def load(record: Record) -> tuple[Checkpoint | None, list[str]]:
    """Returns the newest intact checkpoint, or None; a sentence for each that is refused.

    Raises:
        UnreadableError: if a file can't be read now; the checkpoint may be intact.
    """
    refused: list[str] = []
    for role in reversed(record.roles()):
        match = _STATE.fullmatch(role)
        if match is None:
            continue
        try:
            position, state = _read(record, role)
            # What is read when the engine is there is checked now, while there is a choice.
            for piece in _pieces(record.roles()):
                if piece.first < int(match[2]):
                    record.read_file(piece.role)
            return Checkpoint(position, state, int(match[2]), not refused), refused
        except UnreadableError:
            raise
        except (WorkError, ValueError) as error:
            reason = str(error).partition(";")[0].rstrip(".")
            refused.append(
                f"The checkpoint of {record.id} at {int(match[1])} control steps is not used: "
                f"{reason}."
            )
    return None, refused


def read_replay(record: Record, row: int) -> Tensor:
    """Returns the rows (environments, rows, size + 2) before number `row` that are kept.

    Raises:
        WorkError: if a file is not what was committed.
    """
    pieces = [piece for piece in _pieces(record.roles()) if piece.first < row]
    parts = [_tensors(record, piece.role)[_ROWS] for piece in pieces]
    if not parts:
        return torch.zeros(1, 0, 0)
    rows = torch.cat(parts, dim=1)
    return rows[:, : rows.shape[1] - (pieces[-1].end - row)] if pieces[-1].end > row else rows


def _read(record: Record, role: str) -> tuple[Position, SeedState]:
    """Reads a checkpoint without its replay rows.

    Raises:
        WorkError: if its file is not what was committed.
        ValueError: if it is not one of this run, or of another format.
    """
    tensors = _tensors(record, role)
    try:
        said = json.loads(bytes(tensors.pop(_ENVELOPE).numpy()))
        if said["format"] != FORMAT:
            raise ValueError(f"it is of format {said['format']}, and this jbench has {FORMAT}")
        envelope = _Envelope.model_validate(said)
    except (KeyError, TypeError, ValidationError) as error:
        raise ValueError(f"it is none ({str(error).splitlines()[0]})") from None
    if envelope.run != record.id:
        raise ValueError(f"it is one of {envelope.run}")
    return envelope.position, SeedState(tensors, envelope.scalars)


def _tensors(record: Record, role: str) -> dict[str, Tensor]:
    try:
        return safetensors.torch.load(record.read_file(role))
    except safetensors.SafetensorError as error:
        raise ValueError(f"it is no file of tensors ({error})") from None


def _pieces(roles: Sequence[str]) -> list[_Piece]:
    """Returns the pieces of the replay buffer, in their order."""
    found = [match for role in roles if (match := _PIECE.fullmatch(role))]
    return sorted(_Piece(int(match[1]), int(match[2])) for match in found)


def _next_piece(pieces: Sequence[_Piece], oldest: int, row: int) -> tuple[_Piece, list[_Piece]]:
    """Returns the piece to write, and those before it that it takes in.

    Args:
        pieces: that are there.
        oldest: number of the oldest row that the buffer still has.
        row: number of the row after the last one.
    """
    left = list(pieces)
    piece = _Piece(max(left[-1].end if left else 0, oldest), row)
    while True:
        tail = left[1 - _JOINED :]
        alike = all(other.size == piece.size for other in tail)
        if len(tail) < _JOINED - 1 or not alike or tail[0].first < oldest:
            return piece, list(pieces[len(left) :])
        piece = _Piece(tail[0].first, row)
        del left[1 - _JOINED :]
