"""Tables of text that fit the width of a terminal without breaking words."""

from collections.abc import Sequence

from rich import box
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

_COLUMN_GAP = 3  # characters
_MAX_TERMINAL_LINES = 3  # of a row whose words don't fit side by side


def make_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], width: int
) -> tuple[Table, int]:
    """Returns a table and its width. No word is broken, so that ids can be copied.

    If the longest words of the columns fit side by side, cells are wrapped to the given width.
    Otherwise a row is one line that the terminal wraps, or, if it were wrapped more than twice,
    one line for each of its cells.
    """
    columns = list(zip(header, *rows, strict=True))
    longest_words = [
        max((cell_len(word) for cell in column for word in cell.split()), default=0)
        for column in columns
    ]
    longest_lines = [
        max(cell_len(line) for cell in column for line in cell.split("\n")) for column in columns
    ]
    gaps = _COLUMN_GAP * len(columns)
    if sum(longest_words) + gaps <= width:
        widths = _narrow(longest_lines, longest_words, width - gaps)
        return _table_of_columns(header, rows, widths), width
    if sum(longest_lines) + gaps <= _MAX_TERMINAL_LINES * width or not rows:
        return _table_of_columns(header, rows, longest_lines), sum(longest_lines) + gaps
    return _table_of_cells(header, rows), width


def _narrow(widths: Sequence[int], minima: Sequence[int], total: int) -> list[int]:
    """Returns widths whose sum is at most `total`; the widest column is narrowed first."""
    narrowed = list(widths)
    while sum(narrowed) > total:
        _, widest = max((width, i) for i, width in enumerate(narrowed) if width > minima[i])
        narrowed[widest] -= 1
    return narrowed


def _table_of_columns(
    header: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[int]
) -> Table:
    table = Table(header_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for i, (name, width) in enumerate(zip(header, widths, strict=True)):
        numeric = all(_is_number(row[i]) for row in rows)
        table.add_column(Text(name), justify="right" if numeric else "left", width=width)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _table_of_cells(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Returns a table of column names and cells, with a rule after each row of `rows`."""
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
