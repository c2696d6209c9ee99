"""Panels of a figure: their size and place, their axes, the text around them, and the files."""

import io
import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

DPI = 150
"""Of the PNG files."""

# Inches.
_LEFT, _RIGHT, _TOP, _BELOW = 0.7, 0.2, 0.35, 0.55
_TITLE_HEIGHT, _LINE_HEIGHT, _MARGIN = 0.45, 0.165, 0.15

# Points, and characters that fit an inch of text of the small size.
_SMALL, _MEDIUM, _LARGE = 8.0, 9.0, 12.0
_CHARACTERS = 16


class _Form(NamedTuple):
    """How panels are laid out: sizes in inches, and characters in a line of a legend."""

    columns: int
    width: float
    height: float
    characters: int


_GRID = _Form(columns=3, width=4.0, height=2.7, characters=50)
_SINGLE = _Form(columns=1, width=7.6, height=3.6, characters=48)


def new_figure(panels: int) -> tuple[Figure, list[Axes], Axes]:
    """Returns a figure with so many panels and one more axes for the key; see `arrange`."""
    figure = Figure(facecolor="white")
    FigureCanvasAgg(figure)
    axes = [figure.add_axes((0, 0, 1, 1), label=f"panel {i}") for i in range(panels)]
    key = figure.add_axes((0, 0, 1, 1), label="key")
    key.set_axis_off()
    return figure, axes, key


def style_panel(axes: Axes, title: str, end: float) -> None:
    """Sets the title and the scales of a panel.

    Args:
        axes: of the panel.
        title: above it.
        end: last control step to show.
    """
    axes.set_title(title, fontsize=_MEDIUM, fontweight="bold", loc="left", parse_math=False)
    millions = end >= 1e6
    scale, unit = (1e6, "millions") if millions else (1e3, "thousands")
    axes.set_xlim(0, end)
    # A reward is between 0 and 1 in each of an episode's 1000 steps (paper, section 4).
    axes.set_ylim(-15, 1015)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / scale:g}"))
    axes.set_yticks(range(0, 1001, 200))
    axes.set_xlabel(f"control steps ({unit})", fontsize=_SMALL)
    axes.set_ylabel("episode return", fontsize=_SMALL)
    axes.tick_params(labelsize=_SMALL)
    axes.grid(color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def arrange(
    figure: Figure, axes: Sequence[Axes], key: Axes, title: str, footer: Sequence[str]
) -> None:
    """Gives the drawn panels their places, with a legend below each, and the key its own.

    The sizes follow from the lines of text, so that no legend or note is ever cut or covers a
    curve.

    Args:
        figure: from `new_figure`.
        axes: of the panels, drawn.
        key: of the key, with its labelled artists in it.
        title: of the figure.
        footer: paragraphs below the panels.
    """
    # The key takes the place after the last panel, or, beside a lone one's legend, the right half.
    form, cells = (_SINGLE, axes) if len(axes) == 1 else (_GRID, [*axes, key])
    rows = [cells[i : i + form.columns] for i in range(0, len(cells), form.columns)]
    pitch = _LEFT + form.width + _RIGHT
    width = _MARGIN + form.columns * pitch
    lines = _wrapped(footer, width)
    labels = {cell: _labels(cell, form) for cell in (*axes, key)}
    heights = [
        _TOP + form.height + _BELOW + _MARGIN + _LINE_HEIGHT * below
        for below in _lines_below(rows, labels, key)
    ]
    total = _TITLE_HEIGHT + sum(heights) + len(lines) * _LINE_HEIGHT + 2 * _MARGIN
    figure.set_size_inches(width, total)
    top = total - _TITLE_HEIGHT - _TOP
    for row, height in zip(rows, heights, strict=True):
        for column, cell in enumerate(row):
            left, bottom = _MARGIN + column * pitch + _LEFT, top - form.height
            cell.set_position(
                (left / width, bottom / total, form.width / width, form.height / total)
            )
            # A panel's legend begins below its control steps, the key's own at its upper edge.
            _add_legend(cell, labels[cell], 1.0 if cell is key else -_BELOW / form.height)
        top -= height
    if key not in cells:
        left, bottom = _MARGIN + _LEFT + form.width / 2, (top + heights[-1]) - form.height - _BELOW
        key.set_position((left / width, bottom / total, 0.1, 0.01))
        _add_legend(key, labels[key], 0.0)
    _add_text(figure, _MARGIN / width, 1 - _MARGIN / total, title, _LARGE, "bold")
    below = (_MARGIN + len(lines) * _LINE_HEIGHT) / total
    _add_text(figure, _MARGIN / width, below, "\n".join(lines), _SMALL, "normal")


def to_png(figure: Figure) -> bytes:
    """Returns the figure as PNG, without a time or a version in it."""
    sink = io.BytesIO()
    figure.savefig(sink, format="png", dpi=DPI, metadata={"Software": None})
    return sink.getvalue()


def to_svg(figure: Figure) -> bytes:
    """Returns the figure as SVG: the same bytes for the same figure."""
    sink = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "jbench", "svg.fonttype": "path"}):
        figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    return sink.getvalue()


def _lines_below(
    rows: Sequence[Sequence[Axes]], labels: dict[Axes, list[str]], key: Axes
) -> list[int]:
    """Returns the lines of text below each row of panels."""
    lines = {cell: sum(text.count("\n") + 1 for text in texts) for cell, texts in labels.items()}
    if any(key in row for row in rows):
        lines[key] = 0  # it stands beside panels, not below one
        return [max(lines[cell] for cell in row) for row in rows]
    return [max(lines.values())]


def _labels(axes: Axes, form: _Form) -> list[str]:
    texts = axes.get_legend_handles_labels()[1]
    return ["\n".join(textwrap.wrap(text, form.characters)) or " " for text in texts]


def _add_legend(axes: Axes, labels: list[str], top: float) -> None:
    handles = axes.get_legend_handles_labels()[0]
    if not handles:
        return
    legend = axes.legend(
        handles,
        labels,
        loc="upper left",
        bbox_to_anchor=(0.0, top),
        fontsize=_SMALL,
        frameon=False,
        borderaxespad=0,
        borderpad=0,
        labelspacing=0.35,
        handlelength=3.2,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def _wrapped(paragraphs: Sequence[str], width: float) -> list[str]:
    characters = int((width - 2 * _MARGIN) * _CHARACTERS)
    return [line for text in paragraphs for line in textwrap.wrap(text, characters)]


def _add_text(figure: Figure, x: float, y: float, text: str, size: float, weight: str) -> None:
    figure.text(
        x, y, text, fontsize=size, fontweight=weight, va="top", linespacing=1.3, parse_math=False
    )
