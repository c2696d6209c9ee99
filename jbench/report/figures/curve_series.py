"""Series of learning curves, ours and the paper's, and their key."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jbench.report.data.cells import SOLVED, LearnedCurve
from jbench.report.data.curves import IntArray
from jbench.report.data.published import PublishedCurve
from jbench.report.figure import DOTS, Axis, Band, Dash, ReferenceLine, Series, Shade, Style

BAND_SEEDS = 3
"""Minimum number of seeds for a band."""

SOLVED_STYLE = Style("#d00000", width=0.9)
SOLVED_LINE = ReferenceLine(SOLVED, SOLVED_STYLE)
SOLVED_KEY = (f"solved: a return of {SOLVED}", SOLVED_STYLE)

# Dashed lines are for published curves, dotted ones for points that not all seeds have reached.
LINE_STYLES: tuple[Dash, ...] = ("-", "-.", (0, (8, 1.5)), (0, (6, 1.5, 1, 1.5, 1, 1.5)))
_MARKERS = ("", "o", "s", "^", "v")

_EDGES: dict[bool, Dash] = {False: "-", True: (0, (4, 3))}
"""Style of the edges of a published band, depending on whether single seeds are drawn."""

_WIDTH = 1.7
_BAND_ALPHA = 0.13
_MAX_POINTS = 600
_MAX_MARKED = 40

KEY_COLOR = "0.25"
"""Color of lines in a key that represent curves of any color."""


class Look(NamedTuple):
    """Color and line style of a curve."""

    color: str
    style: int


def returns_axis(label: str) -> Axis:
    """Returns the axis of episode returns, which are between 0 and 1000.

    A reward is between 0 and 1 in each of an episode's 1000 steps (paper, section 4).
    """
    return Axis(label, (-15, 1015), ticks=range(0, 1001, 200))


def steps_axis(end: float) -> Axis:
    """Returns the axis of control steps up to `end`."""
    unit, name = (1e-6, "millions") if end >= 1e6 else (1e-3, "thousands")
    return Axis(f"control steps ({name})", (0, end), unit=unit)


def learned_series(
    item: LearnedCurve,
    look: Look,
    bands: Sequence[tuple[int, int]],
    name: str,
    *,
    each_seed: bool = False,
) -> list[Series]:
    """Returns a curve as a series, preceded by a thin one per seed if `each_seed` is set.

    Args:
        item: the curve.
        look: color and style of the line.
        bands: percentiles of the bands, the widest first.
        name: beginning of the label.
        each_seed: whether every seed is drawn as well.
    """
    curve = item.curve
    shown = thinned(len(curve.control_steps), _MAX_POINTS, curve.window // 4)
    x, seeds = curve.control_steps[shown], curve.seeds[shown]
    enough = seeds >= BAND_SEEDS
    ends = ([np.where(enough, curve.quantile(p)[shown], np.nan) for p in band] for band in bands)
    # Evaluations have few points, and the values between them are unknown.
    few = len(x) == 1 or (not item.cell.kind.smoothed and len(x) <= _MAX_MARKED)
    style = Style(
        look.color,
        LINE_STYLES[look.style % len(LINE_STYLES)],
        _WIDTH,
        # A single point would be invisible without a marker.
        marker=_MARKERS[look.style // len(LINE_STYLES) % len(_MARKERS)] or ("o" if few else ""),
        size=3 if few else 4,
        every=1 if few else max(1, len(x) // 10),
    )
    thin = Style(look.color, width=0.5, alpha=0.45)
    return [
        *(Series(x, row, thin) for row in (curve.each[:, shown] if each_seed else ())),
        Series(
            x,
            curve.quantile(50)[shown],
            style,
            _label(item, name),
            [Band(low, high, _BAND_ALPHA) for low, high in ends] if enough.any() else [],
            partial=seeds < len(item.cell.seeds),
        ),
    ]


def published_series(
    curve: PublishedCurve,
    color: str,
    band: tuple[int, int],
    label: str,
    *,
    each_seed: bool = False,
) -> list[Series]:
    """Returns one of the paper's curves, and the edges of its band.

    The edges are dashed if single seeds are drawn, which are thin lines as well.
    """
    x = curve.control_steps
    edge = Style(color, _EDGES[each_seed], 0.6, alpha=0.4)
    return [
        Series(x, curve.quantiles[50], Style(color, "--", 1.0), label),
        *(Series(x, curve.quantiles[p], edge) for p in band if p in curve.quantiles),
    ]


def curve_key(
    bands: Sequence[tuple[int, int]],
    figure_names: Sequence[str],
    *,
    each_seed: bool = False,
    whose: str = "ours",
) -> list[tuple[str, Style | Shade]]:
    """Returns the key of the kinds of lines and bands.

    Args:
        bands: bands of our curves, the narrowest first; published curves have only that one.
        figure_names: figures of the paper whose curves are shown.
        each_seed: whether single seeds are shown.
        whose: name of the curves that are not published.
    """
    color = KEY_COLOR
    key: list[tuple[str, Style | Shade]] = [
        (f"{whose}: median across seeds", Style(color, width=_WIDTH)),
        (f"{whose}: not reached by all seeds", Style(color, DOTS, _WIDTH)),
    ]
    if each_seed:
        key.append((f"{whose}: a single seed", Style(color, width=0.5, alpha=0.6)))
    for i, band in enumerate(bands):
        key.append(
            (f"{whose}: {percentiles(band)}", Shade(color, _BAND_ALPHA * (len(bands) + 1 - i)))
        )
    source = f"published ({', '.join(figure_names)})"
    one_seed = list(figure_names) == ["Figure 7"]
    if figure_names:
        key.append((f"{source}: {'one seed' if one_seed else 'median'}", Style(color, "--", 1.0)))
    if figure_names and not one_seed:
        edge = Style(color, _EDGES[each_seed], 0.6, alpha=0.5)
        key.append((f"{source}: {percentiles(bands[0])}", edge))
    return [*key, SOLVED_KEY]


def _label(item: LearnedCurve, name: str) -> str:
    cell, curve = item
    seeds = "1 seed" if len(cell.seeds) == 1 else f"{len(cell.seeds)} seeds"
    fewer = int(curve.seeds[-1])
    if fewer < len(cell.seeds):
        seeds += f", {fewer} at the end"
    if cell.diverged.any():
        seeds += f", {int(cell.diverged.sum())} diverged"
    if cell.kind.smoothed:
        seeds += f", window {curve.window}"
    settings = f", {cell.label}" if cell.label else ""
    return f"{cell.prefix}{name}{settings} ({seeds})"


def thinned(points: int, enough: int, max_step: int | None = None) -> IntArray:
    """Returns the indices of points to draw: every k-th and the last.

    Args:
        points: number of points of a curve.
        enough: number of points of a smooth line; at least so many are drawn, if there are.
        max_step: maximum of k; None for any.
    """
    step = max(1, min(points // enough, points if max_step is None else max_step))
    indices: IntArray = np.unique(np.r_[0:points:step, points - 1])
    return indices


def percentiles(band: tuple[int, int]) -> str:
    """Returns the name of a band."""
    return f"{band[0]}th\N{EN DASH}{band[1]}th percentile"
