"""Forest plot: the final returns of all cells with their uncertainty, a row for each."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jbench.names import FULL, TASKS
from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import Summary, scores_of
from jbench.report.data.cells import SOLVED, Cell, in_order, page_tags
from jbench.report.data.published import PUBLISHED, PublishedCurve
from jbench.report.data.summaries import published_beside
from jbench.report.figure import Axis, Figure, Panel, ReferenceLine, Series, Style
from jbench.report.figures.curve_series import KEY_COLOR, SOLVED_KEY, SOLVED_STYLE, interval_bars
from jbench.report.figures.learning_curves import algorithm_colors
from jbench.report.tables import values
from jbench.wording import are, counted

ALL_TASKS = "all tasks"
_MAX_ROWS = 40
_HALF = 0.36  # half the height of the line of a published value, in rows
_BELOW = 0.24  # rows from the mean down to the seeds
_SEED, _MEAN = "one seed", "interquartile mean, 95% interval"
_PUBLISHED = "published median (training return)"
_STYLES = {
    _MEAN: Style(KEY_COLOR, marker="o", size=6),
    _SEED: Style(KEY_COLOR, "", marker="o", size=3, alpha=0.6),
    _PUBLISHED: Style(KEY_COLOR, "--", 1.2),
}
"""Styles of the marks in the key; in a row, they have the color of its algorithm."""


def forest_figure(
    statistics: Sequence[Summary], trained: Sequence[Cell], published: Sequence[PublishedCurve]
) -> Figure:
    """Returns a panel per task with a row per cell, and one for all tasks together.

    Args:
        statistics: statistics of the cells of one kind of return; at least one.
        trained: cells of training returns, which the paper's curves are compared with.
    """
    cells = [one.cell for one in statistics]
    kind = cells[0].kind
    beside = {cell.key: published_beside(cell, published) for cell in trained}
    theirs = {key: found[0] for key, found in beside.items() if found is not None}
    rows = _row_names(cells)
    shown, colors = rows[:_MAX_ROWS], algorithm_colors([cell.algo for cell in cells])
    tasks = in_order({cell.task for cell in cells}, TASKS)
    series = {
        task: [
            line
            for one in statistics
            if one.cell.task == task and one.cell.short_name in shown
            for line in _row(one, shown.index(one.cell.short_name), colors, theirs)
        ]
        for task in tasks
    }
    if len(tasks) > 1:
        together = _together(cells, tasks, shown, colors)
        series |= {ALL_TASKS: together} if together else {}
    lowest = min(float(one.x.min()) for lines in series.values() for one in lines if len(one.x))
    x = Axis(f"final {kind.name} return", (max(0.0, np.floor(lowest / 100) * 100 - 15), 1015))
    y = Axis("", (len(shown) - 0.4, -0.6), ticks=range(len(shown)), names=shown)
    solved = ReferenceLine(SOLVED, SOLVED_STYLE, vertical=True)
    drawn = {entry for lines in series.values() for one in lines for entry in one.entries}
    key = [*((name, style) for name, style in _STYLES.items() if name in drawn), SOLVED_KEY]
    panels = [Panel(task, x, y, lines, [solved]) for task, lines in series.items()]
    return Figure(
        f"Final {kind.plural} with their uncertainty",
        panels,
        key,
        [_note(cells, len(rows) - len(shown), drawn, has_all_tasks=ALL_TASKS in series)],
    )


def _row_names(cells: Sequence[Cell]) -> list[str]:
    """Returns the names of the rows; an algorithm's variant with the defaults comes first."""
    algorithms = list(dict.fromkeys(cell.algo for cell in cells))
    ordered = sorted(
        cells,
        key=lambda c: (
            algorithms.index(c.algo),
            c.representation != FULL,
            c.representation,
            c.words != "",
        ),
    )
    return list(dict.fromkeys(cell.short_name for cell in ordered))


def _note(
    cells: Sequence[Cell], left_out: int, drawn: Collection[str], *, has_all_tasks: bool
) -> str:
    """Returns what the drawn marks mean, and how many rows are left out."""
    steps = {step for cell in cells for step in cell.trained}
    return (
        f"{cells[0].kind.final} Dot with bar: interquartile mean across seeds and its 95% interval "
        f"(uncertainty), for at least {st.MIN_SEEDS} seeds; with fewer than {st.DECIDING_SEEDS} "
        "the interval is too narrow and decides nothing. Small dots: seeds."
        + (
            " Dashed: the paper's median training return in the middle of the episodes of the "
            "final training return."
            if _PUBLISHED in drawn
            else ""
        )
        + (" Rows differ in their control steps." if len(steps) > 1 else "")
        + (f" {counted(left_out, 'more row')} {are(left_out)} in the tables." if left_out else "")
        + (
            f" {ALL_TASKS.capitalize()}: learners with runs on each of them; each task counts the "
            "same, and seeds are resampled within it."
            if has_all_tasks
            else ""
        )
    )


def _row(
    summary: Summary, row: int, colors: Mapping[str, str], theirs: Mapping[Any, float]
) -> list[Series]:
    """Returns the seeds, the interquartile mean and the published value of a cell."""
    cell, final = summary.cell, scores_of(summary.cell).final
    found = summary.get("final_return", "interquartile_mean")
    if found is None or not len(final):
        return []
    color, at = colors[cell.algo], float(row)
    below = np.full(len(final), at + _BELOW)
    seeds = Series(final, below, _style(_SEED, color), entries=(_SEED,), tags=cell.tags)
    lines = [seeds, _mean(found.estimate, at, color, cell.tags, values.seeds(cell))]
    if cell.key in theirs:
        published = Series(
            np.full(2, theirs[cell.key]),
            np.array([at - _HALF, at + _HALF]),
            _style(_PUBLISHED, color),
            detail="published",
            entries=(_PUBLISHED,),
            tags={**cell.tags, "source": PUBLISHED},
        )
        lines.append(published)
    return lines


def _mean(one: st.Estimate, at: float, color: str, tags: Mapping[str, str], detail: str) -> Series:
    """Returns the interquartile mean with its bar in a row."""
    return Series(
        np.array([one.value]),
        np.array([at]),
        _style(_MEAN, color),
        bands=interval_bars(one, along_x=True),
        detail=detail,
        entries=(_MEAN,),
        tags=tags,
    )


def _together(
    cells: Sequence[Cell], tasks: Sequence[str], rows: Sequence[str], colors: Mapping[str, str]
) -> list[Series]:
    """Returns the rows of the learners that have runs on every task, over all tasks."""
    series: list[Series] = []
    for row, name in enumerate(rows):
        mine = {cell.task: cell for cell in cells if cell.short_name == name}
        strata = [scores_of(mine[task]).final for task in tasks if task in mine]
        if len(strata) < len(tasks) or not all(map(len, strata)):
            continue
        one = st.estimate(st.interquartile_mean, strata)
        cell = next(iter(mine.values()))
        tags = page_tags(cell.algo, cell.representation, cell.source)
        runs = f"{counted(sum(map(len, strata)), 'run')} on {counted(len(tasks), 'task')}"
        series.append(_mean(one, float(row), colors[cell.algo], tags, runs))
    return series


def _style(name: str, color: str) -> Style:
    return replace(_STYLES[name], color=color)
