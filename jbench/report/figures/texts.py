"""Texts of figures: their width, and how they are divided into lines."""

import math
from collections.abc import Sequence
from functools import cache
from textwrap import wrap
from typing import Any

from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.font_manager import FontProperties

SMALL = 8.0
"""Font size of most texts, in points."""

SLANT = 35.0
"""Angle in degrees of names below an axis that do not fit side by side."""

_LEAST = 6.0  # points; font size of names side by side
_SPACE = 0.06  # inches between them
_MEASURED_DPI = 100.0  # of drawings, as texts are not exactly as wide at another resolution


def in_lines(text: str, characters: int) -> str:
    """Wraps a text; its own line breaks are kept."""
    return "\n".join(line for part in text.split("\n") for line in wrap(part, characters)) or " "


def shortened(name: str, characters: int, lines: int) -> str:
    """Returns a name wrapped into lines, truncated with "…" if it needs more of them."""
    return "\n".join(wrap(name, characters, max_lines=lines, placeholder=" …"))


def fitted(label: str, width: float) -> str:
    """Returns a label in as many lines as it needs at the small size; `width` is in inches."""
    return in_lines(label, max(8, int(len(label) * width / max(width_of(label), 1e-9))))


def fitted_titles(titles: Sequence[str], width: float, size: float) -> tuple[list[str], float]:
    """Returns bold titles in lines, and the font size in points at which they fit into a width.

    A word is never divided: a wider one makes the font smaller.

    Args:
        width: in inches.
        size: largest font size in points.
    """
    words = [word for title in titles for word in title.split()]
    widest = max((width_of(word, "bold") for word in words), default=0.0)
    size = min(size, SMALL * width / max(widest, 1e-9))
    return [_title_in_lines(title, width * SMALL / size) for title in titles], size


def _title_in_lines(title: str, width: float) -> str:
    """Divides a title that is too wide after its colon, and further where it needs to be."""
    if width_of(title, "bold") <= width:
        return title
    lines: list[str] = []
    for part in title.replace(": ", ":\n").split("\n"):
        lines.append("")
        for word in part.split():
            longer = f"{lines[-1]} {word}".strip()
            if lines[-1] and width_of(longer, "bold") > width:
                lines.append(word)
            else:
                lines[-1] = longer
    return "\n".join(lines)


def size_side_by_side(names: Sequence[str], width: float) -> float | None:
    """Returns the font size in points at which names fit side by side into a width in inches.

    None if it were too small to read.
    """
    size = SMALL * width / (len(names) * (max(map(width_of, names)) + _SPACE))
    return min(SMALL, size) if size >= _LEAST else None


def height_below(names: Sequence[str] | None, width: float) -> float:
    """Returns the height of names below an axis beyond that of a line, in inches."""
    if not names or size_side_by_side(names, width):
        return 0.0
    return max(map(width_of, names)) * math.sin(math.radians(SLANT)) + _SPACE


@cache
def width_of(text: str, weight: str = "normal") -> float:
    """Returns the width of a text of the small size, in inches."""
    measure: Any = _renderer().get_text_width_height_descent
    font = FontProperties(size=SMALL, weight=weight)
    return max(float(measure(t, font, ismath=False)[0]) for t in text.split("\n")) / _MEASURED_DPI


@cache
def _renderer() -> Any:
    make: Any = RendererAgg
    return make(1, 1, _MEASURED_DPI)
