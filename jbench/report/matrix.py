"""The matrix of cells: what has been learned by what, at a glance."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jbench.names import TASKS
from jbench.report import panels
from jbench.report.cells import Cell, in_order
from jbench.report.figures import display_name
from jbench.report.scores import scores_of

CAPTION = (
    "Each cell: the median final return across seeds, in brackets the 10th and 90th percentile "
    "(spread), and the number of seeds n. The colour is that of the median, on a scale that "
    "colour-blind readers can tell apart and that prints in grey. Hatched: no runs."
)


def matrix_figure(cells: Sequence[Cell], sheet: panels.Sheet) -> Figure:
    """Draws a row for each algorithm and representation and a column for each task."""
    tasks = in_order({cell.task for cell in cells}, TASKS)
    rows = list(dict.fromkeys(_row(cell) for cell in cells))
    medians = np.full((len(rows), len(tasks)), np.nan)
    width = max(5.0, 2.6 + 1.25 * len(tasks)) if sheet.text else sheet.grid.whole_width
    height = 1.5 + 0.55 * len(rows) + (0.4 if sheet.text else 0.0)
    small = panels.SMALL if width / (len(tasks) + 1.5) > 0.8 else 5.5
    figure = Figure((width, height), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for cell in cells:
        place = rows.index(_row(cell)), tasks.index(cell.task)
        final = scores_of(cell).final
        if len(final):
            low, medians[place], high = np.percentile(final, (10, 50, 90))
            text = f"{medians[place]:.0f}\n[{low:.0f}, {high:.0f}]\nn = {len(final)}"
            # Viridis is dark below, bright above.
            color = "black" if medians[place] > 450 else "white"
            axes.text(*place[::-1], text, ha="center", va="center", color=color, fontsize=small)
    axes.set_facecolor("0.93")
    axes.patch.set_hatch("////")
    axes.patch.set_edgecolor("0.75")
    mesh = axes.imshow(medians, cmap="viridis", vmin=0, vmax=1000, aspect="auto")
    axes.set_xticks(range(len(tasks)), [_short(task, 20) for task in tasks])
    axes.set_yticks(range(len(rows)), [_short(row, 30) for row in rows])
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_fontsize(small)
        label.set_parse_math(False)
    for label in axes.get_xticklabels() if len(tasks) > 1 else ():
        label.set(rotation=25, ha="right")
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(mesh, ax=axes, shrink=0.9)
    bar.set_label("median final return", fontsize=panels.SMALL)
    bar.ax.tick_params(labelsize=small)
    if sheet.text:
        figure.suptitle("Final returns of all cells", fontsize=12, fontweight="bold")
    return figure


def _short(text: str, characters: int) -> str:
    """Returns a label in lines, three at most: a settings' names may be of any length."""
    return "\n".join(wrap(text, characters, max_lines=3, placeholder=" …"))


def _row(cell: Cell) -> str:
    name = f"{display_name(cell.algo)}, {cell.seen}"
    return f"{cell.prefix}{name}"
