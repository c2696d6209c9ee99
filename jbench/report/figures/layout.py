"""Sizes of figures for a screen or a paper, and positions of panels, legends and notes."""

from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

from jbench.report.figure import Figure, HeatMap

# Inches.
_LEFT, _RIGHT, _TOP, _BELOW = 0.7, 0.2, 0.35, 0.55
_TITLE_HEIGHT, _LINE_HEIGHT = 0.45, 0.165
MARGIN = 0.15

SMALL = 8.0
"""Font size of most texts, in points."""

_TINY = 5.5  # points; font size in narrow cells
_CHARACTERS = 16  # characters of the small size per inch


class _Form(NamedTuple):
    """Arrangement of panels: sizes in inches, and characters in a line of a legend."""

    columns: int
    width: float
    height: float
    characters: int

    @property
    def whole_width(self) -> float:
        """Width of the figure."""
        return MARGIN + self.columns * (_LEFT + self.width + _RIGHT)


class Sheet(NamedTuple):
    """Format of a figure for a medium.

    Attributes:
        grid: arrangement of several panels.
        single: arrangement of a single panel.
        paper: whether it is for a paper, where title and notes belong in the caption.
        stacked: whether the key of a single panel is below the legend instead of beside it.
    """

    grid: _Form
    single: _Form
    paper: bool = False
    stacked: bool = False


SCREEN = Sheet(
    grid=_Form(columns=3, width=4.0, height=2.7, characters=50),
    single=_Form(columns=1, width=7.6, height=3.6, characters=48),
)
SHEETS = {
    None: SCREEN,
    1: Sheet(
        grid=_Form(columns=1, width=2.45, height=1.5, characters=37),
        single=_Form(columns=1, width=2.45, height=1.9, characters=37),
        paper=True,
        stacked=True,
    ),
    2: Sheet(
        grid=_Form(columns=2, width=2.6, height=1.9, characters=38),
        single=_Form(columns=1, width=6.1, height=2.8, characters=40),
        paper=True,
    ),
}
"""By columns of a paper: 3.5 and 7.15 inches wide; None is for a screen."""


class Box(NamedTuple):
    """A rectangle, in inches from the upper left corner of the figure."""

    left: float
    top: float
    width: float = 0.0
    height: float = 0.0


class Layout(NamedTuple):
    """Positions in a figure with a key, in inches.

    Attributes:
        width: width of the figure.
        height: height of the figure.
        panels: boxes of the axes.
        legends: upper left corners of the panels' legends.
        key: upper left corner of the key.
        notes: upper left corner of the notes.
        lines: lines of the notes.
        characters: maximum characters in a line of a legend.
    """

    width: float
    height: float
    panels: list[Box]
    legends: list[Box]
    key: Box
    notes: Box
    lines: list[str]
    characters: int


def lay_out(figure: Figure, sheet: Sheet, *, text: bool) -> Layout:
    """Returns the positions of panels (each with a legend below), key and notes.

    The sizes follow from the lines of text, so that no legend or note is cut off or covers a curve.

    Args:
        figure: a figure with a key.
        sheet: its format.
        text: whether it has title and notes.
    """
    lone = len(figure.panels) == 1
    form = sheet.single if lone else sheet.grid
    width = form.whole_width
    step = (width - MARGIN) / form.columns
    lines = [_count_lines(panel.labels, form) for panel in figure.panels]
    key_height = _LINE_HEIGHT * _count_lines([label for label, _ in figure.key], form)
    panels, legends, key = [], [], None
    top = _TITLE_HEIGHT if text else 0.0
    for first in range(0, len(lines), form.columns):
        row = lines[first : first + form.columns]
        lefts = [MARGIN + _LEFT + column * step for column in range(form.columns)]
        below = top + _TOP + form.height + _BELOW
        panels += [Box(left, top + _TOP, form.width, form.height) for left in lefts[: len(row)]]
        legends += [Box(left, below) for left in lefts[: len(row)]]
        height = _LINE_HEIGHT * max(row)
        if lone and not sheet.stacked:
            # Beside the legend.
            key = Box(lefts[0] + form.width / 2, below)
            height = max(height, key_height)
        elif len(row) < form.columns:
            # In the free space after the last panel.
            key = Box(lefts[len(row)], top + _TOP)
        top = below + height + MARGIN
    if key is None:
        key = Box(MARGIN + _LEFT, top if sheet.stacked else top + _TOP)
        top = key.top + key_height + (MARGIN if sheet.stacked else 0.0)
    characters = int((width - 2 * MARGIN) * _CHARACTERS)
    notes = [line for note in figure.notes for line in wrap(note, characters)] if text else []
    corner = Box(MARGIN, top + MARGIN)
    total = corner.top + _LINE_HEIGHT * len(notes) + MARGIN
    return Layout(width, total, panels, legends, key, corner, notes, form.characters)


def free_size(figure: Figure, sheet: Sheet, *, text: bool) -> tuple[int, float, float]:
    """Returns columns of panels, width and height (inches) of a figure without a key.

    matplotlib lays out such a figure.
    """
    count, heat_map = len(figure.panels), figure.panels[0].heat_map
    columns = min(count, 2) if sheet.paper else count
    if heat_map is None:
        size = (sheet.single.whole_width, sheet.single.height + 1.6) if sheet.paper else (7.6, 4.8)
    elif heat_map.is_map:
        width = sheet.grid.whole_width if sheet.paper else 3.6 * columns + 0.6
        rows = -(-count // columns)
        size = width, rows * (width / columns + 0.3) + (0.9 if sheet.paper else 0.0)
    else:
        size = _table_width(heat_map, sheet), 1.5 + 0.55 * len(heat_map.values) + 0.4 * text
    return columns, *size


def cell_text_size(heat_map: HeatMap, sheet: Sheet) -> float:
    """Returns the font size in and beside the cells of a table, in points."""
    columns = len(heat_map.x) - 1
    return SMALL if _table_width(heat_map, sheet) / (columns + 1.5) > 0.8 else _TINY


def in_lines(text: str, characters: int) -> str:
    """Wraps a text; its own line breaks are kept."""
    return "\n".join(line for part in text.split("\n") for line in wrap(part, characters)) or " "


def free_characters(sheet: Sheet, columns: int) -> int:
    """Returns the characters in a line of a legend or title in a figure without a key."""
    return int(15 * sheet.grid.whole_width / columns) - 8 if sheet.paper else 1000


def _table_width(heat_map: HeatMap, sheet: Sheet) -> float:
    if sheet.paper:
        return sheet.grid.whole_width
    return max(5.0, 2.6 + 1.4 * (len(heat_map.x) - 1))


def _count_lines(labels: Sequence[str], form: _Form) -> int:
    return sum(in_lines(label, form.characters).count("\n") + 1 for label in labels)
