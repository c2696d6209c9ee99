"""Sizes of figures for a screen or a paper, and positions of panels, legend and notes."""

from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

from jbench.report.figure import Axis, Figure, Panel
from jbench.report.figures.texts import (
    SMALL,
    fitted,
    fitted_titles,
    height_below,
    shortened,
    width_of,
)

# Inches.
MARGIN = 0.08
_LEFT, _TICKS = 0.68, 0.42  # of an axis with a label and numbers, and with numbers only
_RIGHT = 0.06  # beside the last panel
_TITLE, _OPPOSITE = 0.22, 0.4
_NUMBERS, _LABEL_LINE = 0.24, 0.15  # below a panel
_TITLE_HEIGHT, _LINE_HEIGHT = 0.35, 0.165
HANDLE, _GAP = 0.32, 0.07  # of an entry of the legend: its line, and the space to its text
_BETWEEN = 0.2
_LEAST = 0.75  # width of a panel beside long names
_LOWER = 0.6  # factor of the height of two wide rows

_MEDIUM = 9.0  # points; font size of the titles of panels on a screen
_CHARACTERS = 16  # characters of the small size per inch

COLUMN_NAME, ROW_NAME = (20, 3), (48, 3)
"""Maximum characters in a line, and lines, of names below and beside a panel."""


class Sheet(NamedTuple):
    """Format of a figure for a medium; sizes in inches.

    Attributes:
        width: of a figure with several panels.
        single: width of a figure with one panel.
        columns: maximum number of panels in a row.
        height: of each of several panels.
        single_height: of a single panel.
        row: height of a row of a panel with named rows.
        paper: whether it is for a paper, where title and notes belong in the caption, and panels
            side by side share their vertical axis.
    """

    width: float
    single: float
    columns: int
    height: float
    single_height: float
    row: float
    paper: bool = False

    @property
    def is_narrow(self) -> bool:
        """Whether it has room for two panels in a row at most."""
        return self.columns <= 2


SCREEN = Sheet(11.8, 4.9, 5, 1.65, 2.5, 0.33)
SHEETS = {
    None: SCREEN,
    1: Sheet(3.5, 3.5, 2, 1.0, 1.6, 0.17, paper=True),
    2: Sheet(7.15, 7.15, 5, 1.5, 2.4, 0.17, paper=True),
}
"""By columns of a paper: 3.5 and 7.15 inches wide; None is for a screen."""


class Box(NamedTuple):
    """A rectangle, in inches from the upper left corner of the figure."""

    left: float
    top: float
    width: float = 0.0
    height: float = 0.0


class Place(NamedTuple):
    """Place of a panel.

    Attributes:
        box: box of the axes.
        title: title in lines.
        title_size: its font size in points.
        x_label: label of the horizontal axis in lines; empty if the panel below has the same.
        first: whether it is the first of its row.
        name_size: maximum characters in a line, and lines, of the names of rows.
    """

    box: Box
    title: str
    title_size: float
    x_label: str
    first: bool
    name_size: tuple[int, int]


class Layout(NamedTuple):
    """Positions in a figure, in inches.

    Attributes:
        legend: label in lines, and upper left corner, of each entry of the legend.
        notes: upper left corner of the notes.
        lines: lines of the notes.
        shared: whether only the first panel of a row has numbers on its vertical axis.
    """

    width: float
    height: float
    panels: list[Place]
    legend: list[tuple[str, Box]]
    notes: Box
    lines: list[str]
    shared: bool


class _Grid(NamedTuple):
    """Sizes of the panels of a figure and of the spaces between them; lengths in inches.

    Attributes:
        columns: panels in a row.
        width: of the figure.
        left: space to the left of the first panel.
        gap: space between two panels.
        panel: width and height of a panel.
        shared: see `Layout.shared`.
        name_size: see `Place.name_size`.
    """

    columns: int
    width: float
    left: float
    gap: float
    panel: tuple[float, float]
    shared: bool
    name_size: tuple[int, int]


def lay_out(figure: Figure, sheet: Sheet, *, text: bool, legend: bool = True) -> Layout:
    """Returns the positions of the panels, of the legend above them, and of the notes below.

    The sizes follow from the texts, so that none is cut off or covers another one.

    Args:
        figure: a figure without heat maps.
        text: whether it has title and notes.
        legend: whether it has a legend.
    """
    grid = _grid(figure, sheet)
    entries, below = _flow([label for label, _ in figure.legend] if legend else [], grid.width)
    title = _TITLE_HEIGHT if text else 0.0
    entries = [(label, Box(box.left, box.top + title)) for label, box in entries]
    places, top = _places(figure, grid, sheet, below + title)
    characters = int((grid.width - 2 * MARGIN) * _CHARACTERS)
    notes = [line for note in figure.notes for line in wrap(note, characters)] if text else []
    corner = Box(MARGIN, top + MARGIN)
    height = corner.top + _LINE_HEIGHT * len(notes) + (MARGIN if notes else 0.0)
    return Layout(grid.width, height, places, entries, corner, notes, grid.shared)


def _grid(figure: Figure, sheet: Sheet) -> _Grid:
    """Returns the sizes of the panels."""
    count = len(figure.panels)
    named = not sheet.paper and figure.panels[0].y.names is not None
    rows = -(-count // (sheet.columns + named))  # panels with named rows need no numbers beside
    columns = -(-count // rows)
    width = sheet.single if count == 1 else sheet.width
    shared = (sheet.paper or named) and len(
        {(p.y.limits, p.y.log, p.y.label) for p in figure.panels}
    ) == 1
    beside = int((width - _LEAST * columns) * _CHARACTERS)
    name_size = min(ROW_NAME[0], beside), int(sheet.row / _LABEL_LINE)
    left = max(_left_of(panel.y, name_size) for panel in figure.panels)
    gap = 0.27 if shared else max(_TICKS, left - _LEFT + _TICKS) + 0.06
    panel_width = (width - left - (columns - 1) * gap - 2 * MARGIN - _RIGHT) / columns
    panel_height = _height(figure, sheet)
    if rows > 1 and sheet.paper and not sheet.is_narrow and not figure.panels[0].y.names:
        panel_height *= _LOWER  # so that two rows are no higher than a third of a page
    return _Grid(columns, width, left, gap, (panel_width, panel_height), shared, name_size)


def _places(figure: Figure, grid: _Grid, sheet: Sheet, top: float) -> tuple[list[Place], float]:
    """Returns the places of the panels below `top`, and where they end."""
    width, height = grid.panel
    room = width + min(grid.gap - MARGIN, MARGIN)  # a title may extend beyond its panel
    largest = SMALL if sheet.paper else _MEDIUM
    titles, title_size = fitted_titles([panel.title for panel in figure.panels], room, largest)
    places = []
    for first in range(0, len(figure.panels), grid.columns):
        row = figure.panels[first : first + grid.columns]
        top += MARGIN + max(map(_above, row, titles[first:]))
        labels = []
        for column, panel in enumerate(row):
            beneath = figure.panels[first + grid.columns + column :][:1]
            same = bool(beneath) and beneath[0].x.label == panel.x.label
            label = "" if same else fitted(panel.x.label, width)
            labels.append(label)
            box = Box(MARGIN + grid.left + column * (width + grid.gap), top, width, height)
            title = titles[first + column]
            places.append(Place(box, title, title_size, label, column == 0, grid.name_size))
        lines = max(label.count("\n") + 1 if label else 0 for label in labels)
        names = max(height_below(panel.x.names, width) for panel in row)
        top += height + _NUMBERS + names + _LABEL_LINE * lines
    return places, top


def _left_of(axis: Axis, size: tuple[int, int]) -> float:
    """Returns the space to the left of a panel; `size` is that of `shortened` names."""
    if axis.names is None:
        return _LEFT if axis.label else _TICKS
    lines = [line for name in axis.names for line in shortened(name, *size).split("\n")]
    return max(map(width_of, lines), default=0.0) + 0.1


def _above(panel: Panel, title: str) -> float:
    """Returns the space above a panel, for its title in lines and a second axis."""
    room = _TITLE + _LABEL_LINE * title.count("\n") if title else 0.0
    return room + (_OPPOSITE if panel.x.opposite else 0.0)


def _height(figure: Figure, sheet: Sheet) -> float:
    """Returns the height of each panel."""
    named = max(len(panel.y.names or ()) for panel in figure.panels)
    if named:
        return max(sheet.row * (named + 0.4), 0.6)
    return sheet.single_height if len(figure.panels) == 1 else sheet.height


def _flow(labels: Sequence[str], width: float) -> tuple[list[tuple[str, Box]], float]:
    """Returns the entries of a legend in rows from the left, and the end of the last row."""
    if not labels:
        return [], 0.0
    entries = []
    left, top, lines = MARGIN, MARGIN, 1
    room = width - 2 * MARGIN - HANDLE - _GAP
    for label in labels:
        text = label if width_of(label) <= room else fitted(label, 0.8 * room)
        across = HANDLE + _GAP + max(map(width_of, text.split("\n")))
        if left > MARGIN and left + across > width - MARGIN:
            left, top, lines = MARGIN, top + _LINE_HEIGHT * lines, 1
        entries.append((text, Box(left, top)))
        left += across + _BETWEEN
        lines = max(lines, text.count("\n") + 1)
    return entries, top + _LINE_HEIGHT * lines
