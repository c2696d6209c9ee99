"""A figure: panels that are drawn by matplotlib, for the page one by one, for files together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jbench.report import style
from jbench.report.style import Look

Draw = Callable[[Axes], None]

MOST_POINTS = 200
"""Points of a curve that are drawn; a panel of a page is about 300 pixels wide."""

_TIPS = 40
"""Points of a curve that have a tip, if it has too many for markers."""

_UNSEEN = [(-1, -1), (1, 1)]
"""Corners of a mark that is not seen: a circle would take 200 bytes."""

_WIDTHS = {1: 3.5, 2: 7.15, None: 9.0}
"""Width of a file in inches, by columns of a paper."""

_LONGEST = 34  # characters of a name beside a panel


@dataclass(frozen=True)
class Panel:
    """A panel of a figure.

    Attributes:
        versions: draws it, by the names of a version, such as `evaluation linear`; the first one
            is that of files.
        size: width and height in inches on the page, where text is 9 points high.
    """

    title: str
    versions: Mapping[str, Draw]
    size: tuple[float, float] = (4.2, 2.5)


@dataclass(frozen=True)
class Chart:
    """A figure.

    Attributes:
        name: of its files and in links.
        note: what marks mean, in a few words.
        data: the frame of which it is drawn; its name is that of the file with the numbers.
        legend: looks by name; a series has the number of its entry.
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
    legend: Mapping[str, Look]
    switches: Sequence[tuple[str, str]] = ()
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
        heights = [
            max(
                panel.size[1] if panel.size[1] > 3 else 0.68 * min(width / across, 4)
                for panel in self.panels[row * across : (row + 1) * across]
            )
            for row in range(down)
        ]
        with mpl.rc_context(style.PAPER):
            figure = Figure(figsize=(width, sum(heights) + self._legend_height(width)))
            figure.set_layout_engine("constrained")
            grid = figure.subplots(down, across, squeeze=False, height_ratios=heights)
            for i, (axes, panel) in enumerate(zip(grid.flat, self.panels, strict=False)):
                next(iter(panel.versions.values()))(axes)
                axes.set_title(panel.title)
                if self.alike and i % across:
                    axes.set_ylabel("")
                if self.alike and i + across < len(self.panels):
                    axes.set_xlabel("")
            for axes in grid.flat[len(self.panels) :]:
                axes.remove()
            self._add_legend(figure, width)
        # Tips are for the page.
        for collection in figure.findobj(mpl.collections.Collection):
            collection.set_urls([None])
        return figure

    def _legend_rows(self, width: float) -> int:
        longest = max(map(len, self.legend), default=1)
        per_row = max(1, int(width / (0.42 + 0.062 * longest)))
        return -(-len(self.legend) // per_row)

    def _legend_height(self, width: float) -> float:
        return 0.17 * self._legend_rows(width) + 0.1

    def _add_legend(self, figure: Figure, width: float) -> None:
        handles = [
            Line2D([], [], color=look.color, linestyle=look.linestyle, marker=look.marker)
            for look in self.legend.values()
        ]
        if handles:
            figure.legend(
                handles,
                [shortened(name) for name in self.legend],
                loc="outside upper left",
                ncols=-(-len(handles) // self._legend_rows(width)),
                handlelength=1.8,
                columnspacing=1.2,
                borderaxespad=0,
            )


def shortened(name: str) -> str:
    """Returns a name that leaves room for a panel beside it."""
    return name if len(name) <= _LONGEST else f"{name[:20]}…{name[-10:]}"


def narrow(axes: Axes, inches: float = 2.2) -> bool:
    """Returns whether a panel is narrower, as before its labels are placed."""
    figure = axes.get_figure(root=True)
    return figure is not None and axes.get_position().width * figure.get_figwidth() < inches


def thinned(count: int, most: int = MOST_POINTS) -> Any:
    """Returns indices of at most so many points: half of them equally, half logarithmically."""
    if count <= most:
        return np.arange(count)
    half = most // 2
    equal = np.linspace(0, count - 1, most - half)
    logarithmic = np.geomspace(1, count, half) - 1
    return np.unique(np.concatenate([equal, logarithmic]).round().astype(int))


def add_points(
    axes: Axes,
    x: Any,
    y: Any,
    tips: Sequence[str],
    look: Look,
    number: int,
    *,
    size: float = 4.5,
    hollow: bool = False,
    alpha: float = 1,
    seen: bool = True,
    zorder: float = 3,
) -> None:
    """Draws marks, each with a tip on the page.

    Args:
        number: of the series in the legend.
        size: diameter in points.
        seen: else there are only the tips.
    """
    face = "none" if not seen else "#ffffff" if hollow else look.color
    axes.scatter(
        x,
        y,
        s=size**2,
        marker=look.marker if seen else _UNSEEN,
        facecolors=face,
        edgecolors=None if look.marker == "|" else look.color if seen and hollow else "none",
        alpha=alpha if seen else None,
        urls=list(tips),
        gid=series(number),
        zorder=zorder,
    )


def add_tips(axes: Axes, x: Any, y: Any, tips: Sequence[str], look: Look, number: int) -> None:
    """Draws the markers of a curve; if it has many points, some unseen ones that have tips."""
    shown = thinned(len(x), _TIPS)
    add_points(
        axes,
        x[shown],
        y[shown],
        [tips[int(i)] for i in shown],
        look,
        number,
        size=mpl.rcParams["lines.markersize"],
        seen=len(x) <= _TIPS,
    )


def add_unseen(axes: Axes, x: Any, y: Any, tips: Sequence[str], number: int) -> None:
    """Adds tips to a line, on the page; nothing is drawn."""
    add_points(axes, x, y, tips, Look(style.SOFT), number, seen=False)


def series(number: int) -> str:
    """Returns the id of the marks of a series, by which the page hides them."""
    return f"series-{number}"


def numbers(legend: Mapping[str, Look]) -> dict[str, int]:
    """Returns the number of each entry of a legend."""
    return {name: i for i, name in enumerate(legend)}
