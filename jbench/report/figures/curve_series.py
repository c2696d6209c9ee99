"""Series of learning curves, ours and the paper's, and their key."""

from collections.abc import Callable, Hashable, Iterable, Sequence

import numpy as np

from jbench.report.analysis.reduction import Point
from jbench.report.analysis.statistics import Estimate
from jbench.report.data.cells import IMPORTED, SOLVED, Cell, LearnedCurve, page_tags
from jbench.report.data.curves import BAND_SEEDS, IntArray
from jbench.report.data.published import PublishedCurve
from jbench.report.figure import DOTS, Axis, Band, Dash, Panel, ReferenceLine, Series, Shade, Style
from jbench.report.tables import values
from jbench.wording import counted

SOLVED_STYLE = Style("#8a8a8a", width=0.8)
SOLVED_LINE = ReferenceLine(SOLVED, SOLVED_STYLE)
SOLVED_KEY = (f"solved ({SOLVED})", SOLVED_STYLE)

# Dashed lines are for published curves, dotted ones for points that not all seeds have reached.
_LINE_STYLES: tuple[Dash, ...] = ("-", "-.", (0, (8, 1.5)), (0, (6, 1.5, 1, 1.5, 1, 1.5)))
_MARKERS = ("", "o", "s", "^", "v")

_EDGES: dict[bool, Dash] = {False: "-", True: (0, (4, 3))}
"""Style of the edges of a published band, depending on whether single seeds are drawn."""

_WIDTH = 1.7
_BAND_ALPHA = 0.13
_MAX_POINTS = 600
_MAX_MARKED = 40

KEY_COLOR = "#404040"
"""Color of lines in a key that represent curves of any color."""

BAND = (10, 90)
"""Percentiles of the band around a curve."""

QUARTILES = (25, 75)
"""Percentiles of a second, narrower band."""

MEDIAN_KEY, PUBLISHED_KEY = "line: median", "published: median"
_ONE_SEED_KEY, _EDGES_KEY = "published: one seed", "published: {}"


def line_style(nth: int) -> Dash:
    """Returns the style of the n-th line of a color."""
    return _LINE_STYLES[nth % len(_LINE_STYLES)]


def line_numbers(
    cells: Iterable[Cell], line_of: Callable[[Cell], Hashable] = lambda cell: cell.short_name
) -> dict[Hashable, int]:
    """Returns the number of each line among those of its algorithm, in all panels of a figure.

    Lines of the default settings come first, so that they are solid; see `line_style`.
    """
    numbers: dict[str, dict[Hashable, int]] = {}
    for cell in sorted(cells, key=lambda cell: cell.words != ""):
        of_algo = numbers.setdefault(cell.algo, {})
        of_algo.setdefault(line_of(cell), len(of_algo))
    return {line: number for of_algo in numbers.values() for line, number in of_algo.items()}


def interval_bars(one: Estimate, *, along_x: bool = False) -> list[Band]:
    """Returns the interval of a single point as a bar, if it is known."""
    if not np.isfinite(one.low):
        return []
    return [Band(np.array([one.low]), np.array([one.high]), bars=True, along_x=along_x)]


def mean_point(point: Point, at: float, style: Style) -> Series:
    """Returns the interquartile mean of a representation's seeds with its interval, at an x."""
    words = point.cell.representation_words
    return Series(
        np.array([at]),
        np.array([point.estimate.value]),
        style,
        words,
        interval_bars(point.estimate),
        detail=values.count_of(point.cell, len(point.final)),
        tags=point.cell.tags,
    )


def returns_axis(label: str) -> Axis:
    """Returns the axis of episode returns, which are between 0 and 1000.

    A reward is between 0 and 1 in each of an episode's 1000 steps (paper, section 4).
    """
    return Axis(label, (-15, 1015), ticks=range(0, 1001, 200))


def steps_axis(end: float) -> Axis:
    """Returns the axis of control steps up to `end`, or to 1 if nothing was trained."""
    end = max(end, 1.0)
    unit, name = (1e-6, "millions") if end >= 1e6 else (1e-3, "thousands")
    return Axis(f"control steps ({name})", (0, end), unit=unit)


def learned_series(
    item: LearnedCurve,
    color: str,
    nth: int,
    bands: Sequence[tuple[int, int]],
    name: str,
    *,
    each_seed: bool = False,
) -> list[Series]:
    """Returns a curve as a series, preceded by a thin one per seed if `each_seed` is set.

    Args:
        nth: index of the line's style and marker.
        bands: percentiles of the bands, the widest first.
        name: beginning of the label.
    """
    curve = item.curve
    shown = drawn_points(len(curve.control_steps), _MAX_POINTS, curve.window // 4)
    x, seeds = curve.control_steps[shown], curve.seeds[shown]
    enough = seeds >= BAND_SEEDS
    ends = ([np.where(enough, curve.quantile(p)[shown], np.nan) for p in band] for band in bands)
    # Evaluations have few points, and the values between them are unknown.
    few = len(x) == 1 or (not item.cell.kind.smoothed and len(x) <= _MAX_MARKED)
    style = Style(
        color,
        line_style(nth),
        _WIDTH,
        # A single point would be invisible without a marker.
        marker=_MARKERS[nth // len(_LINE_STYLES) % len(_MARKERS)] or ("o" if few else ""),
        size=3 if few else 4,
        every=1 if few else max(1, len(x) // 10),
    )
    label = ", ".join(filter(None, (item.cell.prefix + name, item.cell.words)))
    entries, tags = (label, MEDIAN_KEY), item.cell.tags
    median = Series(
        x,
        curve.quantile(50)[shown],
        style,
        label,
        [Band(low, high, _BAND_ALPHA) for low, high in ends] if enough.any() else [],
        detail=_detail(item),
        entries=entries,
        tags=tags,
        partial=seeds < len(item.cell.seeds),
    )
    if not each_seed:
        return [median]
    thin = Style(color, width=0.5, alpha=0.45)
    returns = curve.each[:, shown]
    return [*(Series(x, row, thin, entries=entries, tags=tags) for row in returns), median]


def published_series(
    curve: PublishedCurve,
    color: str,
    band: tuple[int, int],
    entry: str,
    *,
    labeled: bool = False,
    each_seed: bool = False,
) -> list[Series]:
    """Returns one of the paper's curves, and the edges of its band.

    The edges are dashed if single seeds are drawn, which are thin lines as well.

    Args:
        band: percentiles.
        entry: entry of the legend for the curve's color.
        labeled: whether the legend has that entry only because of this curve.
    """
    x = curve.control_steps
    tags = page_tags(curve.algo, curve.representation, curve.source, curve.task)
    if curve.source == IMPORTED:
        key, detail = entry, IMPORTED
    else:
        key = _ONE_SEED_KEY if curve.seeds == 1 else PUBLISHED_KEY
        detail = f"{curve.figure_name}, {counted(curve.seeds, 'seed')}"
    median = Series(
        x,
        curve.quantiles[50],
        Style(color, "--", 1.0),
        entry if labeled else "",
        detail=detail if labeled else f"published {entry} ({detail})",
        entries=(entry, key),
        tags=tags,
    )
    edge = Style(color, _EDGES[each_seed], 0.6, alpha=0.4)
    entries = (entry, key, _EDGES_KEY.format(percentiles(band)))
    ends = [curve.quantiles[percent] for percent in band if percent in curve.quantiles]
    return [median, *(Series(x, end, edge, entries=entries, tags=tags) for end in ends)]


def curve_key(
    panels: Sequence[Panel],
    bands: Sequence[tuple[int, int]],
    *,
    each_seed: bool = False,
) -> list[tuple[str, Style | Shade]]:
    """Returns the key of the kinds of lines and bands that panels show.

    Args:
        bands: bands of our curves, the narrowest first; published curves have only that one.
    """
    series = [one for panel in panels for one in panel.series]
    shown = {entry for one in series for entry in one.entries}
    color = KEY_COLOR
    key: list[tuple[str, Style | Shade]] = [(MEDIAN_KEY, Style(color, width=_WIDTH))]
    if any(one.partial is not None and one.partial.any() for one in series):
        key.append(("not reached by all seeds", Style(color, DOTS, _WIDTH)))
    if each_seed:
        key.append(("a single seed", Style(color, width=0.5, alpha=0.6)))
    for i, band in enumerate(bands if any(one.bands for one in series) else ()):
        key.append((percentiles(band), Shade(color, _BAND_ALPHA * (len(bands) + 1 - i))))
    for name in (PUBLISHED_KEY, _ONE_SEED_KEY):
        if name in shown:
            key.append((name, Style(color, "--", 1.0)))
    if PUBLISHED_KEY in shown:
        edge = Style(color, _EDGES[each_seed], 0.6, alpha=0.5)
        key.append((_EDGES_KEY.format(percentiles(bands[0])), edge))
    return [*key, SOLVED_KEY]


def details_text(panels: Sequence[Panel]) -> str:
    """Returns a sentence on the seeds of the curves in panels."""
    named: dict[str, list[str]] = {}
    for panel in panels:
        for one in (one for one in panel.series if one.label and one.detail):
            same = named.setdefault(one.detail, [])
            where = one.label if len(panels) == 1 else f"{one.label} on {panel.title}"
            same += [] if where in same else [where]
    if len(named) == 1:
        return f"Each curve: {next(iter(named))}."
    # Labels contain commas.
    return " ".join(f"{detail}: {'; '.join(labels)}." for detail, labels in named.items())


def _detail(item: LearnedCurve) -> str:
    cell, curve = item
    seeds = counted(len(cell.seeds), "seed")
    fewer = int(curve.seeds[-1])
    if fewer < len(cell.seeds):
        seeds += f", {fewer} at the end"
    if cell.diverged_count:
        seeds += f", {cell.diverged_count} diverged"
    if cell.kind.smoothed:
        seeds += f", window {curve.window}"
    return seeds


def drawn_points(points: int, enough: int, max_step: int | None = None) -> IntArray:
    """Returns the indices of points to draw: every k-th and the last.

    Args:
        points: number of points of a curve.
        enough: a curve of at most this many points is drawn whole, a longer one by at least this
            many.
        max_step: maximum of k; None for any.
    """
    step = max(1, min(points // enough, points if max_step is None else max_step))
    indices: IntArray = np.unique(np.r_[0:points:step, points - 1])
    return indices


def percentiles(band: tuple[int, int]) -> str:
    """Returns the name of a band."""
    return f"{band[0]}th\N{EN DASH}{band[1]}th percentile"
