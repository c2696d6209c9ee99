"""A figure: panels that are drawn by matplotlib, for the page one by one, for files together."""

from collections.abc import Callable, Container, Mapping, Sequence
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

ROWS: Any = {"columns": 2, "alike": False, "minimum": 440}
"""Fields of a chart whose panels have names beside their rows."""

_WIDTHS = {1: 3.5, 2: 7.15, None: 9.0}
"""Width of a file in inches, by columns of a paper."""


@dataclass(frozen=True)
class Panel:
    """A panel of a figure.

    Attributes:
        versions: draws it, by the names of a version, such as `evaluation linear`; the first one
            is that of files.
        changes: names of versions that modify the drawing of the previous version; the others begin
            with empty axes.
        size: width and height in inches on the page, where text is 9 points high.
    """

    title: str
    versions: Mapping[str, Draw]
    size: tuple[float, float] = (4.2, 2.5)
    changes: Container[str] = ()


@dataclass(frozen=True)
class Chart:
    """A figure.

    Attributes:
        name: of its files and in links.
        note: what marks mean, in a few words.
        data: name of the frame of which it is drawn, and of the file with the numbers.
        legend: looks by name.
        switches: pairs of version names that a button exchanges, the shown one first.
        columns: panels side by side in a wide file.
        alike: whether the axes of all panels have the same labels; files write them once.
        minimum: width in pixels at which panels of the page wrap.
    """

    name: str
    title: str
    note: str
    panels: Sequence[Panel]
    data: str
    legend: Mapping[str, Look] = field(default_factory=dict)
    switches: Sequence[Sequence[str]] = ()
    columns: int = 3
    alike: bool = True
    minimum: int = 340

    def figure(self, columns: int | None = None) -> Figure:
        """Returns the figure for a file.

        Args:
            columns: width in columns of a paper, 1 (3.5 in) or 2 (7.15 in); None for a screen.
        """
        width = _WIDTHS[columns]
        across = min(len(self.panels), self.columns)
        if width < 4:
            # Words and names beside panels leave no room for a second one, unless there are many.
            across = 2 if self.minimum < 300 or (self.alike and len(self.panels) > 4) else 1
        down = -(-len(self.panels) // across)
        usual = 0.68 * min(width / across, 4)
        sizes = [panel.size[1] if panel.size[1] > 3 else usual for panel in self.panels]
        heights = [max(sizes[row * across : (row + 1) * across]) for row in range(down)]
        per_row = max(1, int(width / (0.42 + 0.062 * max(map(len, self.legend), default=1))))
        legend_rows = -(-len(self.legend) // per_row)
        with mpl.rc_context(style.PAPER):
            figure = Figure(figsize=(width, sum(heights) + 0.17 * legend_rows + 0.1))
            grid = figure.subplots(down, across, squeeze=False, height_ratios=heights)
            for i, (axes, panel) in enumerate(zip(grid.flat, self.panels, strict=False)):
                next(iter(panel.versions.values()))(axes)
                axes.set_title(panel.title)
                if self.alike and i % across:
                    axes.set_ylabel("")
                if self.alike and i + across < len(self.panels):
                    axes.set_xlabel("")
                marks.leave_out_empty(axes)
            for axes in grid.flat[len(self.panels) :]:
                axes.remove()
            if self.legend:
                entries = [
                    Line2D([], [], color=look.color, linestyle=look.line, marker=look.marker)
                    for look in self.legend.values()
                ]
                figure.legend(
                    entries,
                    list(map(marks.shortened, self.legend)),
                    loc="outside upper left",
                    ncols=-(-len(self.legend) // legend_rows),
                    handlelength=1.8,
                    columnspacing=1.2,
                    borderaxespad=0,
                )
            # Placed once, or each format would place it and draw it twice.
            ConstrainedLayoutEngine().execute(figure)
        # Tips are for the page.
        for collection in figure.findobj(mpl.collections.Collection):
            collection.set_urls([None])
        return figure


def by_task(
    rows: pd.DataFrame,
    draw: Callable[..., None],
    width: float = 4.2,
    height: float | Callable[[pd.DataFrame], float] = 2.5,
    by: Sequence[str] = ("task",),
) -> list[Panel]:
    """Returns a panel for each task, or other group, which a function draws of its rows on axes.

    The title is the last name of the group.
    """
    return [
        Panel(
            str(names[-1]),
            {"": partial(draw, group)},
            (width, height(group) if callable(height) else height),
        )
        for names, group in rows.groupby([*by], sort=False)
    ]
