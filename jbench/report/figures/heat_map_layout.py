"""Sizes of figures of heat maps, which matplotlib lays out, and of the texts in them."""

from jbench.report.figure import Figure, HeatMap, Panel
from jbench.report.figures.layout import ROW_NAME, Sheet
from jbench.report.figures.texts import SMALL, shortened, width_of

# Inches.
_BAR = 0.75  # width of a color bar with its label
_BESIDE = 0.2  # between the texts of two cells
_NAMES_LEAST = 0.35  # of the width of a table, for the names of its rows


def free_size(figure: Figure, sheet: Sheet, *, text: bool) -> tuple[int, float, float]:
    """Returns columns of panels, width and height (inches) of a figure of heat maps."""
    count, heat_map = len(figure.panels), figure.panels[0].heat_map
    assert heat_map is not None
    if not heat_map.is_map:
        below = _BAR if bar_is_below(heat_map, sheet) else 0.0
        height = 1.1 + 0.5 * len(heat_map.values) + 0.4 * text + below
        return count, _table_width(heat_map, sheet), height
    columns = min(count, 2) if sheet.paper else count
    width = sheet.width if sheet.paper else 3.6 * columns + 0.6
    height = -(-count // columns) * (width / columns + 0.3) + (0.9 if sheet.paper else 0.0)
    return columns, width, height


def bar_is_below(heat_map: HeatMap, sheet: Sheet) -> bool:
    """Returns whether the color bar is below the heat maps, as there is no room beside them."""
    return sheet.paper and (heat_map.is_map or sheet.is_narrow)


def table_texts(panel: Panel, sheet: Sheet) -> tuple[float, tuple[int, int]]:
    """Returns how the texts of a table fit into their cells and beside them.

    Returns:
        The font size in points, and the maximum characters in a line, and lines, of the names of
        rows (see `texts.shortened`).
    """
    assert panel.heat_map is not None
    bar = 0.0 if bar_is_below(panel.heat_map, sheet) else _BAR
    room = _table_width(panel.heat_map, sheet) - bar
    widest = max((width_of(cell.text) for cell in panel.heat_map.texts), default=0.0)
    cells = (len(panel.heat_map.x) - 1) * (widest + _BESIDE)
    beside = max(room - cells, _NAMES_LEAST * room)
    names = [name for name in panel.y.names or () if width_of(name) > 0]
    characters = min([ROW_NAME[0], *(int(len(name) * beside / width_of(name)) for name in names)])
    lines = [shortened(name, characters, ROW_NAME[1]) for name in names]
    size = SMALL * room / (cells + max(map(width_of, lines), default=0.0))
    return min(SMALL, size), (characters, ROW_NAME[1])


def title_characters(sheet: Sheet) -> int:
    """Returns the characters in a line of a panel's title; on paper, two are in a row."""
    return int(15 * sheet.width / 2) - 8 if sheet.paper else 1000


def _table_width(heat_map: HeatMap, sheet: Sheet) -> float:
    return sheet.width if sheet.paper else max(5.0, 2.6 + 1.4 * (len(heat_map.x) - 1))
