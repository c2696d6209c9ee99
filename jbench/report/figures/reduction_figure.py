"""Figure of the final return of each representation."""

from collections.abc import Sequence

import numpy as np

from jbench.names import FULL, kind_of
from jbench.report import formatting
from jbench.report.analysis.reduction import BASELINES, SCALED, Group, Point
from jbench.report.analysis.statistics import MIN_SEEDS
from jbench.report.figure import Axis, Figure, Panel, ReferenceLine, Series, Shade, Style
from jbench.report.figures import curve_series
from jbench.report.figures.encoders import look_of

_BASELINE_STYLES = {FULL: Style("#595959"), SCALED: Style("#b8a200", "--")}
_BESIDE = 0.2
"""Distance of the seeds from their mean, as a fraction of the distance between representations."""


def reduction_figure(groups: Sequence[Group]) -> Figure:
    """Returns a panel for each group: its baselines as bands, its representations as points.

    Args:
        groups: groups of cells of one kind of return; at least one.
    """
    kind = groups[0].points[0].cell.kind
    key: list[tuple[str, Style | Shade]] = [
        ("interquartile mean, 95% interval", Style(curve_series.KEY_COLOR, marker="o", size=5)),
        ("one seed", Style(curve_series.KEY_COLOR, "", marker="o", size=2.5, alpha=0.5)),
        curve_series.SOLVED_KEY,
    ]
    seeds = [
        f"{group.name} at {formatting.steps(group.control_steps)} control steps: "
        + ", ".join(f"{p.cell.representation_words} {len(p.final)}" for p in group.points)
        for group in groups
    ]
    short = [cell.name for group in groups for cell in group.short]
    note = (
        f"{kind.final} Points and lines: interquartile means across seeds; bars and bands: their "
        f"95% intervals (uncertainty), for at least {MIN_SEEDS} seeds. Full is the observation "
        "itself; scaled is the observation with the encoders' scaling, so that a difference from "
        f"it is due to reduction alone. Seeds: {'; '.join(seeds)}."
        + (
            f" Left out because some seed has not reached these steps: {'; '.join(short)}."
            if short
            else ""
        )
    )
    title = f"Does reduction help? Final {kind.plural}"
    return Figure(title, [_panel(group) for group in groups], key, [note])


def _panel(group: Group) -> Panel:
    first = group.points[0].cell
    by_kind = {kind_of(point.cell.representation): point for point in group.points}
    baselines = [_baseline(name, by_kind[name]) for name in BASELINES if name in by_kind]
    reduced = [p for p in group.points if kind_of(p.cell.representation) not in BASELINES]
    reduced.sort(key=lambda point: (point.input_size or 0, point.cell.representation_words))
    return Panel(
        group.name,
        Axis(
            "representation, by number of latents",
            (-0.5, len(reduced) - 0.5),
            ticks=range(len(reduced)),
            names=[point.cell.representation_words for point in reduced],
        ),
        curve_series.returns_axis(f"final {first.kind.axis}"),
        [one for column, point in enumerate(reduced) for one in _point_series(column, point)],
        [curve_series.SOLVED_LINE, *baselines],
    )


def _baseline(name: str, point: Point) -> ReferenceLine:
    one = point.estimate
    interval = (one.low, one.high) if np.isfinite(one.low) else None
    words = point.cell.representation_words
    return ReferenceLine(one.value, _BASELINE_STYLES[name], words, interval=interval)


def _point_series(column: int, point: Point) -> list[Series]:
    """Returns the seeds of a representation, and their interquartile mean with its interval."""
    color, marker = look_of(kind_of(point.cell.representation))
    seed = Style(color, "", marker=marker, size=2.5, alpha=0.5)
    mean = curve_series.mean_point(point, column, Style(color, marker=marker, size=6))
    beside = np.full(len(point.final), column - _BESIDE)
    return [Series(beside, point.final, seed, entries=(mean.label,), tags=mean.tags), mean]
