"""A figure: panels that are drawn by matplotlib, for the page one by one, for files together."""

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from jbench.report import style
from jbench.report.figures import marks
from jbench.report.style import Look

Draw = Callable[[Axes], None]

# Fields of a chart whose panels have names beside their rows.
ROWS: Any = {"columns": 2, "alike": False, "minimum": 440}
_WIDTHS = {1: 3.5, 2: 7.15, None: 9.0}  # of a file in inches, by columns of a paper
# Of a title in a file, in inches: what is left of it, its usual character, and a line of it.
_LABELS = 0.45
_CHARACTER = 0.064
_LINE = 0.14
_LEGEND = 48  # characters of a name in a legend, which fit into a column of a paper


@dataclass(frozen=True)
class Panel:
    """A panel of a figure."""

    title: str
    versions: Mapping[str, Draw]  # by name, such as `evaluation linear`; files have the first one
    size: tuple[float, float]  # in inches on the page, where text is 9 points high


@dataclass(frozen=True)
class Chart:
    """A figure."""

    name: str  # of its files and in links
    title: str
    note: str  # what marks mean, in a few words
    panels: Sequence[Panel]
    legend: Mapping[str, Look] = field(default_factory=dict)
    switches: Sequence[Sequence[str]] = ()  # names that a button exchanges, the shown one first
    columns: int = 3  # panels side by side in a wide file
    alike: bool = True  # whether all axes have the same labels, which files write once
    minimum: int = 340  # pixels at which panels of the page wrap
    data: str = ""  # name of the file with the numbers, if not that of the figure

    def figure(self, columns: int | None = None) -> Figure:
        """Returns the figure for a file, as wide as columns of a paper; None for a screen."""
        width = _WIDTHS[columns]
        across = self._across(width)
        titles = [_wrapped(panel.title, width / across) for panel in self.panels]
        heights = self._heights(titles, across, width)

        names = marks.shortened(self.legend, _LEGEND)
        longest = max(map(len, names), default=1)
        names_per_row = max(1, int(width / (0.42 + 0.062 * longest)))
        legend_rows = -(-len(self.legend) // names_per_row)

        with mpl.rc_context(style.PAPER):
            figure = Figure(figsize=(width, sum(heights) + 0.17 * legend_rows + 0.1))
            grid = figure.subplots(len(heights), across, squeeze=False, height_ratios=heights)
            self._draw(grid.flat, titles, across)
            if self.legend:
                self._add_legend(figure, names, -(-len(self.legend) // legend_rows))

            # Placed once, or each format would place it and draw it twice.
            ConstrainedLayoutEngine().execute(figure)

        # Tips are for the page.
        for collection in figure.findobj(mpl.collections.Collection):
            collection.set_urls([None])

        return figure

    def _across(self, width: float) -> int:
        """Returns how many panels are side by side in a file of a width in inches."""
        if width >= 4:
            return min(len(self.panels), self.columns)

        # Words and names beside panels leave no room for a second one, unless there are many.
        has_room = self.minimum < 300 or (self.alike and len(self.panels) > 4)
        return 2 if has_room else 1

    def _heights(self, titles: Sequence[str], across: int, width: float) -> list[float]:
        """Returns the height of each row of panels in inches."""
        usual = 0.68 * min(width / across, 4)
        heights = []
        for panel, title in zip(self.panels, titles, strict=True):
            _, height = panel.size
            shown = height if height > 3 else usual
            heights.append(shown + _LINE * title.count("\n"))

        return [max(heights[row : row + across]) for row in range(0, len(heights), across)]

    def _draw(self, grid: Iterator[Axes], titles: Sequence[str], across: int) -> None:
        """Draws the panels into the axes of a grid, and removes the axes that are left."""
        for place, (panel, title) in enumerate(zip(self.panels, titles, strict=True)):
            axes = next(grid)
            draw = next(iter(panel.versions.values()))
            draw(axes)
            axes.set_title(title)

            is_left = place % across == 0
            is_lowest = place + across >= len(self.panels)
            if self.alike and not is_left:
                axes.set_ylabel("")
            if self.alike and not is_lowest:
                axes.set_xlabel("")

            marks.leave_out_empty(axes)

        for axes in grid:
            axes.remove()

    def _add_legend(self, figure: Figure, names: Sequence[str], columns: int) -> None:
        """Adds the legend above the panels, with these names, in columns."""
        entries = [
            Line2D([], [], color=look.color, linestyle=look.line, marker=look.marker)
            for look in self.legend.values()
        ]
        figure.legend(
            entries,
            names,
            loc="outside upper left",
            ncols=columns,
            handlelength=1.8,
            columnspacing=1.2,
            borderaxespad=0,
        )


def _wrapped(title: str, inches: float) -> str:
    """Returns a title in lines that fit above a panel, which has labels on its left."""
    return textwrap.fill(title, int((inches - _LABELS) / _CHARACTER), break_on_hyphens=False)


def by_task(
    rows: pd.DataFrame,
    draw: Callable[..., None],
    size: tuple[float, float] | Callable[[pd.DataFrame], tuple[float, float]] = (4.2, 2.5),
    by: Sequence[str] = ("task",),
) -> list[Panel]:
    """Returns a panel for each group of rows, whose last name is the title, drawn by a function."""
    return [
        Panel(str(names[-1]), {"": partial(draw, group)}, size(group) if callable(size) else size)
        for names, group in rows.groupby([*by], sort=False)
    ]
