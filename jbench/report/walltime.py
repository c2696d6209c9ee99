"""Return against wall time: what learning costs on the machine that it ran on."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.names import TASKS
from jbench.report import drawing, panels
from jbench.report.cells import in_order
from jbench.report.curves import FloatArray
from jbench.report.drawing import LINE_STYLES, LearnedCurve, Manner
from jbench.report.figures import algorithm_colors, display_name

_UNITS = ((7200.0, 3600.0, "hours"), (120.0, 60.0, "minutes"), (0.0, 1.0, "seconds"))
_POINTS = 400


def wall_time_figure(
    learned: Sequence[LearnedCurve], processors: Sequence[str], manner: Manner
) -> panels.PanelFigure | None:
    """Draws the median return against the median wall time of the seeds.

    Args:
        learned: curves of one robot each.
        processors: that the runs were made on.
        manner: of drawing.

    Returns:
        The figure, with a panel for each task; None where no run tells its times.
    """
    timed = [(item, drawn) for item in learned if len((drawn := timed_curve(item))[0])]
    if not timed:
        return None
    tasks = in_order({item.cell.task for item, _ in timed}, TASKS)
    colors = algorithm_colors([item.cell.algo for item, _ in timed])
    figure, axes, key = panels.new_figure(len(tasks))
    for panel, task in zip(axes, tasks, strict=True):
        of_task = [(item, drawn) for item, drawn in timed if item.cell.task == task]
        longest = max(float(drawn[0][-1]) for _, drawn in of_task)
        size, unit = next((s, name) for least, s, name in _UNITS if longest >= least)
        panels.style_panel(panel, task, longest / size)
        panel.xaxis.set_major_formatter("{x:g}")
        panel.set_xlabel(f"wall time of a run ({unit})", fontsize=panels.SMALL)
        drawing.draw_solved(panel)
        for item, (times, median) in of_task:
            same = [i.cell for i, _ in of_task if i.cell.algo == item.cell.algo]
            style = LINE_STYLES[_position(same, item) % len(LINE_STYLES)]
            color, label = colors[item.cell.algo], _label(item)
            every = max(1, len(times) // _POINTS)
            shown = np.r_[0 : len(times) : every, len(times) - 1]
            x, y = times[shown] / size, median[shown]
            panel.plot(x, y, color=color, linestyle=style, linewidth=1.5, label=label)
    key.plot([], [], color="0.25", lw=1.5, label="median return at the median time of the seeds")
    drawing.draw_solved_key(key)
    footer = (
        "Wall time is counted from a run's beginning, evaluations included, on the machine it ran "
        f"on ({'; '.join(processors) or 'not recorded'}), beside whatever else ran there: runs at "
        "the same time share its cores. Seeds of the batched engine learn together, and each "
        "counts the time of all. A line ends where the first of its seeds does.",
    )
    panels.arrange(figure, axes, key, "Episode return against wall time", footer, manner.sheet)
    return figure


def timed_curve(item: LearnedCurve) -> tuple[FloatArray, FloatArray]:
    """Returns the median wall time (s) at each point, and the median return there.

    Only where every seed is and tells its time: a median over other seeds further on could go back.
    """
    cell, curve = item
    times = cell.wall_time[:, curve.window - 1 :]
    every = np.isfinite(times).all(axis=0) & np.isfinite(curve.quantile(50))
    return np.median(times[:, every], axis=0), curve.quantile(50)[every]


def wall_time_frame(learned: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns what is drawn: task, source, algo, representation, wall_time (s), episode_return."""
    parts = []
    for item in learned:
        times, median = timed_curve(item)
        names = {name: getattr(item.cell, name) for name in ("task", "source", "algo")}
        names |= {"representation": item.cell.seen}
        parts.append(pd.DataFrame({**names, "wall_time": times, "episode_return": median}))
    return pd.concat(parts, ignore_index=True)


def _position(cells: Sequence[object], item: LearnedCurve) -> int:
    return next(i for i, cell in enumerate(cells) if cell is item.cell)


def _label(item: LearnedCurve) -> str:
    cell = item.cell
    seeds = "1 seed" if len(cell.seeds) == 1 else f"{len(cell.seeds)} seeds"
    name = f"{display_name(cell.algo)}, {cell.seen} ({seeds})"
    return f"{cell.prefix}{name}"
