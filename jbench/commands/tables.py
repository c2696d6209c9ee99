"""Tables on a terminal: what gives way where it is narrower than they are.

No number is ever cut, and no line breaks within a word, or within a value in brackets such as
`[128, 128]`. Until a table fits, these steps are taken in order:

1. Long texts wrap between words, and so do headings.
2. The columns named `below` become lines under the table.
3. Long words, such as ids, are shortened in the middle; different ones stay different. A sentence
   below the table says where they are whole, since nobody can type them so.
4. The columns named `spare` are left out, in the order of their names.
5. Long words are shortened further.
6. Each row becomes a list with a line for each cell.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from jbench.commands.cells import INTERVAL, unbroken, without_middles, wrapped

_TEXT = 12  # least width of a column of longer texts
_SHORTEST = 24  # characters that are kept of a long word, or more if two would become equal
_SHORTEST_AT_ALL = 14  # where even the spare columns are left out
_GAP = 3  # spaces between columns; there is one at each side of the table
_NARROW_GAP = 2  # where a table would not fit otherwise
_PIPE = 200  # longest line of a text in a pipe, which has no width


@dataclass
class _Column:
    """The cells of a column, and how wide it must and may be."""

    name: str
    cells: list[str]

    @cached_property
    def is_number(self) -> bool:
        """Whether all cells are numbers or intervals, which are aligned to the right."""
        return all(map(INTERVAL.fullmatch, self.cells))

    @cached_property
    def least(self) -> int:
        """The width in which no number is cut and no word is broken."""
        pieces = self.name.split()
        for cell in self.cells:
            pieces += unbroken(cell)

        longest = max(map(cell_len, pieces), default=0)
        if any(len(unbroken(cell)) > 1 for cell in self.cells):  # a text
            longest = max(longest, min(self.natural, _TEXT))
        return longest

    @cached_property
    def natural(self) -> int:
        """The width in which every cell is one line."""
        lines = self.name.splitlines()
        for cell in self.cells:
            lines += cell.splitlines()

        return max(map(cell_len, lines), default=0)

    @property
    def justify(self) -> Literal["left", "right"]:
        """The side of the column at which its cells begin or end."""
        if self.is_number:
            return "right"
        return "left"

    def shortened(self, limit: int) -> "_Column":
        """Returns the column with words of at most `limit` characters, if cells stay different."""
        different = len(set(self.cells))
        while limit < self.natural:
            cells = [without_middles(cell, limit) for cell in self.cells]
            if len(set(cells)) == different:
                return _Column(self.name, cells)
            limit += 1
        return self


@dataclass
class TableLayout:
    """What is printed of a table."""

    columns: list[_Column]
    below: list[_Column] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    is_list: bool = False
    gap: int = _NARROW_GAP


def print_table(
    console: Console,
    title: str,
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    width: int | None,
    spare: Sequence[str],
    below: Sequence[str],
) -> None:
    """Prints a table.

    Args:
        console: where it is printed; its width is set.
        title: printed above the table.
        header: names of the columns.
        rows: the cells of each row.
        width: characters of a line; None in a pipe, where nothing gives way.
        spare: columns that may be left out, the least important one first.
        below: columns that may become lines under the table, each after the row's first cell.
    """
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    columns = [_Column(name, list(column)) for name, column in zip(header, cells, strict=True)]
    if width is None:
        layout = TableLayout(columns, gap=_GAP)
        width = max(_PIPE, _least(columns, gap=_GAP))
    else:
        layout = fitted(columns, width, spare, below)

    # A title is a sentence: its lines end where the table's do.
    console.width = max(width, *map(cell_len, title.split()), 1)
    console.print(Text(title, style="bold"))
    if layout.is_list:
        grid = _list(layout, width)
    else:
        grid = _grid(layout, width)

    console.width = max(width, sum(column.width or 0 for column in grid.columns) + _margins(2))
    console.print(grid)
    _print_below(console, layout, columns)


def fitted(
    columns: list[_Column], width: int, spare: Sequence[str], below: Sequence[str]
) -> TableLayout:
    """Returns the first layout that fits; see this module for their order."""
    for gap in (_GAP, _NARROW_GAP):
        if _least(columns, gap=gap) <= width:
            return TableLayout(columns, gap=gap)

    beneath = [column for column in columns if column.name in below]
    beside = [column for column in columns if column.name not in below]
    names = [column.name for column in beside]
    order = [name for name in spare if name in names]
    for shortest in (_SHORTEST, _SHORTEST_AT_ALL):
        for count in range(len(order) + 1):
            if _least(_without(beside, order[:count]), shortest) <= width:
                left_out = _as_few_as_possible(order[:count], beside, width, shortest)
                kept = _without(beside, left_out)
                return TableLayout(_shortened_to_fit(kept, width, shortest), beneath, left_out)

    room = _value_width(columns, width)
    return TableLayout([column.shortened(room) for column in columns], is_list=True)


def _as_few_as_possible(
    left_out: list[str], columns: list[_Column], width: int, shortest: int
) -> list[str]:
    """Returns the columns to leave out, without those that fit beside the more important ones."""
    for name in reversed(left_out):
        others = [other for other in left_out if other != name]
        if _least(_without(columns, others), shortest) <= width:
            left_out = others

    return left_out


def _without(columns: list[_Column], names: Sequence[str]) -> list[_Column]:
    """Returns the columns that have other names."""
    return [column for column in columns if column.name not in names]


def _least(columns: list[_Column], limit: int | None = None, gap: int = _NARROW_GAP) -> int:
    """Returns the width that columns need side by side, if long words are shortened to a limit."""
    if limit is not None:
        columns = [column.shortened(limit) for column in columns]
    return sum(column.least for column in columns) + _margins(len(columns), gap)


def _shortened_to_fit(columns: list[_Column], width: int, shortest: int) -> list[_Column]:
    """Returns columns of which as few characters as possible are left out."""
    fits = shortest
    too_long = max(column.natural for column in columns) + 1
    while too_long - fits > 1:
        limit = (fits + too_long) // 2
        if _least(columns, limit) <= width:
            fits = limit
        else:
            too_long = limit

    return [column.shortened(fits) for column in columns]


def _margins(columns: int, gap: int = _NARROW_GAP) -> int:
    """Returns how much of a line the gaps between columns take."""
    return gap * max(columns - 1, 0) + 2


def _widths(layout: TableLayout, width: int) -> list[int]:
    """Returns the width of each column: texts that need more lines get more of what is left."""
    widths = [column.least for column in layout.columns]
    for _ in range(width - _least(layout.columns, gap=layout.gap)):
        narrow = [i for i, column in enumerate(layout.columns) if widths[i] < column.natural]
        if not narrow:
            break
        widest = max(narrow, key=lambda i: layout.columns[i].natural / max(widths[i], 1))
        widths[widest] += 1
    return widths


def _grid(layout: TableLayout, width: int) -> Table:
    """Returns a table with a line for each row."""
    padding = (0, 1, 0, layout.gap - _NARROW_GAP)
    grid = Table(header_style="bold", box=box.SIMPLE_HEAD, pad_edge=False, padding=padding)
    widths = _widths(layout, width)
    for column, wide in zip(layout.columns, widths, strict=True):
        grid.add_column(Text(column.name), justify=column.justify, width=wide)

    for row in zip(*(column.cells for column in layout.columns), strict=True):
        grid.add_row(*map(Text, map(wrapped, row, widths)))

    return grid


def _list(layout: TableLayout, width: int) -> Table:
    """Returns a table of names and values, with an empty line after each row."""
    values = layout.columns
    names = _name_width(values, width)
    room = max(_value_width(values, width), *(column.least for column in values))
    grid = Table(box=box.SIMPLE, pad_edge=False, show_header=False, padding=(0, 1, 0, 0))
    grid.add_column(width=names, style="bold")
    grid.add_column(width=room)

    for row in zip(*(column.cells for column in values), strict=True):
        for column, cell in zip(layout.columns, row, strict=True):
            if cell:
                grid.add_row(Text(column.name), Text(wrapped(cell, room)))
        grid.add_section()

    return grid


def _name_width(columns: list[_Column], width: int) -> int:
    """Returns the width of the names in a list of names and values."""
    longest_word = max(max(map(cell_len, column.name.split()), default=0) for column in columns)
    natural = max(cell_len(column.name) for column in columns)
    return min(natural, max(longest_word, width // 3))


def _value_width(columns: list[_Column], width: int) -> int:
    """Returns the width of the values in a list of names and values."""
    return max(width - _name_width(columns, width) - _margins(2), _SHORTEST_AT_ALL)


def _print_below(console: Console, layout: TableLayout, columns: list[_Column]) -> None:
    """Prints what had no room in a table of these columns below it."""
    first = layout.columns[0]
    for column in layout.below:
        for name, cell in zip(first.cells, column.cells, strict=True):
            if cell:
                text = without_middles(f"{name}: {column.name}: {cell}", console.width)
                console.print(Text(wrapped(text, console.width)))

    if layout.left_out:
        names = ", ".join(layout.left_out)
        console.print(Text(f"Too narrow for {names}: a wider terminal, or --json, shows all."))

    whole = {cell for column in columns for cell in column.cells}
    if not whole.issuperset(cell for column in layout.columns for cell in column.cells):
        console.print(
            Text("… stands for a part of a name: a wider terminal, or --json, shows it whole.")
        )
