"""The rows of a replay buffer as files of a record.

The rows are stored in pieces: each checkpoint adds a piece with the new rows, and when there are 32
pieces they are rewritten as one.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from jbench.agents.batched.replay import ReplayBuffer
from jbench.store import Record
from jbench.store.roles import CHECKPOINT

_MAX_PIECES = 32
_ROLE = re.compile(r"replay-(\d+)-(\d+)\.safetensors")
_ROWS = "rows"


class Piece(NamedTuple):
    """Rows `first` to `end` (exclusive) of a replay buffer, counted from the first one ever."""

    first: int
    end: int

    @property
    def role(self) -> str:
        """Role of the piece's file in the record."""
        return f"replay-{self.first:012d}-{self.end:012d}.safetensors"


class NewPiece(NamedTuple):
    """The files, by role, that a checkpoint adds for its replay buffer, and the roles to remove."""

    files: Mapping[str, bytes]
    ended: Collection[str]


def pieces_among(roles: Sequence[str]) -> list[Piece]:
    """Returns the pieces among the files of a record, in the order of their rows."""
    matches = filter(None, map(_ROLE.fullmatch, roles))
    return sorted(Piece(int(match[1]), int(match[2])) for match in matches)


def piece_file(piece: Piece, rows: Tensor) -> dict[str, bytes]:
    """Returns the file of a piece by its role; its rows are (environments, rows, width)."""
    return {piece.role: safetensors.torch.save({_ROWS: rows.contiguous()})}


def first_piece(replay: ReplayBuffer, index: int) -> NewPiece:
    """Returns a piece with all rows of the replay buffer of a run, by its index in the engine."""
    piece = Piece(replay.oldest, replay.row)
    return NewPiece(piece_file(piece, replay.rows_since(index, piece.first)), ())


def next_piece(replay: ReplayBuffer, index: int, roles: Sequence[str]) -> NewPiece:
    """Returns the piece with the rows that the record does not have yet.

    If there are too many pieces, it has their rows too. Pieces end that were joined, or of which
    neither this checkpoint nor the previous one needs a row.

    Args:
        replay: of the engine in which the run has the index.
        roles: of the files of the record.
    """
    pieces = pieces_among(roles)
    joined: list[Piece] = []
    if len(pieces) >= _MAX_PIECES:
        # A piece that begins before the oldest row in the buffer stays as it is.
        joined = [piece for piece in pieces if piece.first >= replay.oldest]

    if joined:
        first = joined[0].first
    else:
        first = max([replay.oldest, *(piece.end for piece in pieces)])

    piece = Piece(first, replay.row)
    file = piece_file(piece, replay.rows_since(index, first))

    oldest_of_previous = replay.oldest - (replay.row - _previous_row(roles, replay.row))
    unneeded = [piece for piece in pieces if piece.end <= oldest_of_previous]
    return NewPiece(file, {piece.role for piece in (*joined, *unneeded)})


def stored_rows(record: Record, row: int) -> Tensor:
    """Returns the rows (environments, rows, width) of a record before number `row`.

    Raises as `read_tensors`.
    """
    pieces = [piece for piece in pieces_among(record.roles()) if piece.first < row]
    if not pieces:
        return torch.zeros(1, 0, 0)

    rows = torch.cat([read_tensors(record, piece.role)[_ROWS] for piece in pieces], dim=1)
    too_many = max(0, pieces[-1].end - row)
    return rows[:, : rows.shape[1] - too_many]


def read_tensors(record: Record, role: str) -> dict[str, Tensor]:
    """Returns the tensors of a safetensors file of a record, by name.

    Raises a WorkError if the file is damaged, and a ValueError if it is no safetensors file.
    """
    try:
        return safetensors.torch.load(record.read_file(role))
    except safetensors.SafetensorError as error:
        raise ValueError(f"it is not a safetensors file ({error})") from None


def _previous_row(roles: Sequence[str], row: int) -> int:
    """Returns the row at which the newest checkpoint of a record was made; `row` without one."""
    for match in filter(None, map(CHECKPOINT.fullmatch, reversed(roles))):
        return int(match[2])
    return row
