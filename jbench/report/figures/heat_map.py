"""The matrix of cells: an overview of final returns."""

from collections.abc import Sequence
from statistics import multimode

import numpy as np
import pandas as pd

from jbench.names import TASKS
from jbench.report import formatting
from jbench.report.analysis.scores import final_percentiles, scores_of
from jbench.report.data.cells import Cell, in_order
from jbench.report.figure import Axis, CellText, Figure, HeatMap, Panel
from jbench.report.tables import values

_BRIGHT = 450
"""Median return above which a cell's color is bright enough for black text."""


def caption(cells: Sequence[Cell]) -> str:
    """Returns the caption of the matrix."""
    kind, steps = cells[0].kind, compared_steps(cells)
    others = any(_steps(cell) != steps for cell in cells)
    colored = (
        f"cells of {formatting.steps(steps)} control steps" if steps else "cells of equal steps"
    )
    return (
        f"Each cell: median final {kind.name} return across seeds, in brackets the 10th and 90th "
        "percentile (spread), the control steps of training, and the number of seeds n. "
        f"{kind.final} The color shows the median, on a scale that is safe for color-blind "
        f"readers and prints in gray. Only {colored} are colored, the most frequent number: "
        f"others are not comparable with them{' and are white' if others else ''}. Hatched: no "
        f"runs.{values.on_divergence(cells)}"
    )


def compared_steps(cells: Sequence[Cell]) -> int | None:
    """Returns the most frequent number of control steps of cells; of several, the largest.

    None if every cell has seeds with different numbers of control steps.
    """
    steps = (_steps(cell) for cell in cells)
    return max(multimode(one for one in steps if one is not None), default=None)


def matrix_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns the numbers of the figure.

    Columns: task, source, algo, representation, returns (kind), steps_min and steps_max (control
    steps of training), seeds, diverged, median, q10, q90 (NaN without a final return).
    """
    rows = []
    for cell in cells:
        low, median, high = final_percentiles(cell)
        rows.append(
            {
                **cell.columns,
                "steps_min": cell.trained[0],
                "steps_max": cell.trained[1],
                "seeds": len(scores_of(cell).final),
                "diverged": cell.diverged_count,
                "median": median,
                "q10": low,
                "q90": high,
            }
        )
    return pd.DataFrame(rows)


def matrix_figure(cells: Sequence[Cell]) -> Figure:
    """Returns a heat map with a row per algorithm and representation, and a column per task.

    Args:
        cells: at least one cell; all of one kind of return.
    """
    tasks = in_order({cell.task for cell in cells}, TASKS)
    rows = list(dict.fromkeys(values.algorithm_name(cell) for cell in cells))
    medians = np.full((len(rows), len(tasks)), np.nan)
    texts = []
    colored_steps = compared_steps(cells)
    for cell in cells:
        row, column = rows.index(values.algorithm_name(cell)), tasks.index(cell.task)
        low, median, high = final_percentiles(cell)
        if np.isnan(median):
            continue
        seeds = len(scores_of(cell).final)
        steps, count = values.trained(cell).text, values.count_of(cell, seeds)
        band = f" [{low:.0f}, {high:.0f}]" if seeds > 1 else ""
        text = f"{median:.0f}{band}\n{steps} steps\n{count}"
        colored = colored_steps is not None and _steps(cell) == colored_steps
        if colored:
            medians[row, column] = median
        # Viridis is dark for low values and bright for high ones.
        color = "white" if colored and median <= _BRIGHT else "black"
        texts.append(CellText(row, column, text, color, framed=not colored))
    x, y = (np.arange(len(names) + 1, dtype=np.float64) - 0.5 for names in (tasks, rows))
    kind = cells[0].kind
    heat_map = HeatMap(x, y, medians, f"median final {kind.name} return", (0, 1000), texts=texts)
    panel = Panel(
        "",
        Axis("", (x[0], x[-1]), ticks=range(len(tasks)), names=tasks),
        Axis("", (y[-1], y[0]), ticks=range(len(rows)), names=rows),
        heat_map=heat_map,
    )
    return Figure(f"Final {kind.plural} of all cells", [panel], notes=[caption(cells)])


def _steps(cell: Cell) -> int | None:
    """Returns the control steps of training of a cell; None if its seeds differ."""
    low, high = cell.trained
    return low if low == high else None
