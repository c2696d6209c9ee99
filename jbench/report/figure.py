"""A figure as data: panels of series, reference lines and heat maps.

The modules of figures turn cells and curves into these. `plotting.py` draws them with matplotlib
for files, and `page/tooltips.py` writes their values as JSON for the page.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jbench.report.data.curves import BoolArray, FloatArray

Dash = str | tuple[float, tuple[float, ...]]
"""A line style of matplotlib; "" is no line."""

DOTS = ":"
"""Line style of the `partial` points of a series."""


@dataclass(frozen=True)
class Style:
    """Style of a line and its markers; sizes are in points, colors are matplotlib's.

    Attributes:
        every: a marker is drawn at every n-th point.
        hollow: whether the markers are white inside.
    """

    color: str
    dash: Dash = "-"
    width: float = 1.5
    alpha: float = 1.0
    marker: str = ""
    size: float = 3.0
    every: int = 1
    hollow: bool = False


@dataclass(frozen=True)
class Shade:
    """Style of an area in the key."""

    color: str
    alpha: float


@dataclass(frozen=True)
class Band:
    """A range (points,) at each point of a series; NaN where there is none.

    Attributes:
        bars: whether it is drawn as error bars instead of an area.
        along_x: whether it is a range of x instead of y; only for bars.
    """

    low: FloatArray
    high: FloatArray
    alpha: float = 0.15
    bars: bool = False
    along_x: bool = False


@dataclass(frozen=True)
class Series:
    """Values (points,) along a line; NaN is a gap.

    Attributes:
        label: text in legend and tooltip; a series without a label is in neither.
        detail: further text in the tooltip, such as the number of seeds.
        entries: further entries of the legend or the key that this series belongs to.
        tags: task, algorithm, representation and source, by which a page filters.
        bands: drawn in the line's color, the widest first.
        partial: (points,) where the line is dotted; None: nowhere.
        edges: (points + 1,) edges of the bins of a histogram, which is drawn as steps.
        zorder: series with a higher value cover the others.
    """

    x: FloatArray
    y: FloatArray
    style: Style
    label: str = ""
    bands: Sequence[Band] = ()
    detail: str = ""
    entries: Sequence[str] = ()
    tags: Mapping[str, str] = field(default_factory=dict)
    partial: BoolArray | None = None
    edges: FloatArray | None = None
    zorder: float = 2.0

    @property
    def belongs_to(self) -> tuple[str, ...]:
        """Entries of legend and key with any of which a page hides it: first its own label."""
        return tuple(dict.fromkeys(entry for entry in (self.label, *self.entries) if entry))


@dataclass(frozen=True)
class ReferenceLine:
    """A line across a whole panel, such as a threshold, at a value of y, or of x if vertical.

    Attributes:
        label: text in the legend; "" for none.
        interval: ends of a band around it.
    """

    at: float
    style: Style
    label: str = ""
    vertical: bool = False
    interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class CellText:
    """The text in a cell of a heat map.

    Attributes:
        framed: whether the cell is white with a frame, for a text without a value.
    """

    row: int
    column: int
    text: str
    color: str
    framed: bool = False


@dataclass(frozen=True)
class HeatMap:
    """Values on a plane, shown as colors.

    Attributes:
        x: (columns + 1,) edges of the columns.
        y: (rows + 1,) edges of the rows.
        values: (rows, columns); NaN is no value.
        label: label of the color bar.
        limits: values of the first and last color.
        log: whether the color scale is logarithmic.
        is_map: whether x and y are lengths on one scale. If not, the heat map is a table with
            named rows and columns, hatched where it has neither a value nor a text.
    """

    x: FloatArray
    y: FloatArray
    values: FloatArray
    label: str
    limits: tuple[float, float]
    log: bool = False
    texts: Sequence[CellText] = ()
    is_map: bool = False


@dataclass(frozen=True)
class Axis:
    """An axis of a panel.

    Attributes:
        limits: first and last value.
        log: whether its scale is logarithmic.
        unit: factor of values in tick labels, such as 0.001 for an axis in thousands.
        ticks: positions of the ticks; None: at round values.
        names: tick labels; None: their values.
        integer: whether ticks are only at whole numbers.
        opposite: label and factor of a second scale above a horizontal axis.
    """

    label: str
    limits: tuple[float, float]
    log: bool = False
    unit: float = 1.0
    ticks: Sequence[float] | None = None
    names: Sequence[str] | None = None
    integer: bool = False
    opposite: tuple[str, float] | None = None


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        series: in the order of the legend.
        references: drawn below the series; first in the legend.
        heat_map: drawn below the series.
        arrow: start and end, (x, y) each.
        text: text in the middle of a panel without data.
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series] = ()
    references: Sequence[ReferenceLine] = ()
    heat_map: HeatMap | None = None
    arrow: tuple[tuple[float, float], tuple[float, float]] | None = None
    text: str = ""


@dataclass(frozen=True)
class Figure:
    """Panels, and the text around them.

    Attributes:
        title: heading above the panels; omitted in figures for a paper.
        panels: at least one panel.
        key: label and style of each kind of line and area, below the legend's lines.
        notes: paragraphs on how to read the figure.
    """

    title: str
    panels: Sequence[Panel]
    key: Sequence[tuple[str, Style | Shade]] = ()
    notes: Sequence[str] = ()

    @property
    def caption(self) -> str:
        """The notes as one text."""
        return " ".join(self.notes)

    @property
    def legend(self) -> list[tuple[str, Style | Shade]]:
        """Label and style of each line in the legend, which all panels share, then the key."""
        found: dict[str, Style | Shade] = {}
        for panel in self.panels:
            lines: list[ReferenceLine | Series] = [*panel.references, *panel.series]
            for line in lines:
                if line.label:
                    found.setdefault(line.label, line.style)
        return [*found.items(), *self.key]

    @property
    def entry_numbers(self) -> list[list[list[int]]]:
        """Numbers of the entries of the legend that each series of each panel belongs to."""
        numbers = {label: i for i, (label, _) in enumerate(self.legend)}
        return [
            [[numbers[entry] for entry in one.belongs_to if entry in numbers] for one in of.series]
            for of in self.panels
        ]

    @property
    def corners(self) -> int:
        """Number of points of all lines and of both sides of their bands."""
        series = (series for panel in self.panels for series in panel.series)
        return sum(len(one.x) * (1 + 2 * len(one.bands)) for one in series)


def padded(values: FloatArray, *, log: bool = False) -> tuple[float, float]:
    """Returns axis limits with a margin of 5% around the finite values.

    On a logarithmic axis only positive values count. There must be at least one value.
    """
    usable = values[np.isfinite(values) & ((values > 0) | (not log))]
    low, high = float(usable.min()), float(usable.max())
    if log:
        margin = (high / low) ** 0.05 if high > low else 1.1
        return low / margin, high * margin
    margin = 0.05 * (high - low) or 0.5
    return low - margin, high + margin
