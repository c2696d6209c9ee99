"""Tables of text, in the width of a terminal if their words fit."""

from collections.abc import Sequence

from rich import box
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

_BETWEEN = 3  # characters between two columns
_MOST = 3  # lines of the terminal that a row may take if its words do not fit into one


def drawn(header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> tuple[Table, int]:
    """Returns a table and its width. No word is broken, so that ids can be copied.

    If the longest words of the columns fit side by side, cells are wrapped to the width. Otherwise
    a row is one line that is wider, or, if that is much wider, one line for each of its cells.
    """
    columns = list(zip(header, *rows, strict=True))
    words = [
        max((cell_len(w) for cell in column for w in cell.split()), default=0) for column in columns
    ]
    lines = [
        max(cell_len(line) for cell in column for line in cell.split("\n")) for column in columns
    ]
    around = _BETWEEN * len(columns)
    if sum(words) + around <= width:
        return _columns(header, rows, _narrowed(lines, words, width - around)), width
    if sum(lines) + around <= _MOST * width or not rows:
        return _columns(header, rows, lines), sum(lines) + around
    return _records(header, rows), width


def _narrowed(widths: Sequence[int], least: Sequence[int], total: int) -> list[int]:
    """Returns widths of columns of at most a total: the widest that can be is made narrower."""
    found = list(widths)
    while sum(found) > total:
        _, widest = max((w, i) for i, w in enumerate(found) if w > least[i])
        found[widest] -= 1
    return found


def _columns(header: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[int]) -> Table:
    """Returns a row for each row; columns of numbers are aligned to the right."""
    table = Table(header_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for i, (name, width) in enumerate(zip(header, widths, strict=True)):
        right = all(_is_number(row[i]) for row in rows)
        table.add_column(Text(name), justify="right" if right else "left", width=width)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _records(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Returns a line for each cell, with the name of its column, and a rule after each row."""
    table = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for row in rows:
        for name, cell in zip(header, row, strict=True):
            table.add_row(Text(name), Text(cell))
        table.add_section()
    return table


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "") or "0")
    except ValueError:
        return False
    return True
