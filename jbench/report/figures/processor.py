"""Figure of return against processor time."""

from collections.abc import Hashable, Mapping, Sequence

import numpy as np
import pandas as pd

from jbench.names import TASKS, kind_of
from jbench.report.data.cells import Cell, LearnedCurve, in_order
from jbench.report.data.curves import FloatArray, centers
from jbench.report.figure import Axis, Figure, Panel, Series, Style
from jbench.report.figures import curve_series
from jbench.report.figures.encoders import look_of
from jbench.report.figures.learning_curves import algorithm_colors
from jbench.report.tables import values

_UNITS = ((7200.0, 3600.0, "hours"), (120.0, 60.0, "minutes"), (0.0, 1.0, "seconds"))
_MAX_POINTS = 400

_Timed = tuple[LearnedCurve, FloatArray, FloatArray]
"""A curve, and its times and medians; see `timed_curve`."""


def processor_time_figure(
    learned: Sequence[LearnedCurve], processors: Sequence[str]
) -> Figure | None:
    """Returns the figure of median return against the median processor time of the seeds.

    Args:
        learned: curves of one kind of return, without sequences of robots.
        processors: names of the runs' processors.

    Returns:
        The figure, with a panel per task; None if no run has recorded its times.
    """
    timed = [(item, *timed_curve(item)) for item in learned]
    timed = [one for one in timed if len(one[1])]
    if not timed:
        return None
    kind = learned[0].cell.kind
    tasks = in_order({item.cell.task for item, *_ in timed}, TASKS)
    colors = algorithm_colors([item.cell.algo for item, *_ in timed])
    numbers = curve_series.line_numbers(item.cell for item, *_ in timed)
    note = (
        f"Shown: the {kind.long}. Processor time of a seed is counted since its run began, over "
        "all cores, evaluations included; seeds that are trained in one process share its time "
        f"equally. It was measured on: {'; '.join(processors) or 'unknown processor'}. A line ends "
        "where its first seed ends; a seed that diverged counts with return 0 from then on, and "
        "not in the time."
    )
    return Figure(
        f"{kind.name.capitalize()} return against processor time",
        [
            _panel(task, [one for one in timed if one[0].cell.task == task], colors, numbers)
            for task in tasks
        ],
        [
            ("median return at the median time of the seeds", Style(curve_series.KEY_COLOR)),
            curve_series.SOLVED_KEY,
        ],
        [note],
    )


def _panel(
    task: str,
    timed: Sequence[_Timed],
    colors: Mapping[str, str],
    numbers: Mapping[Hashable, int],
) -> Panel:
    kind = timed[0][0].cell.kind
    longest = max(float(times[-1]) for _, times, _ in timed)
    size, unit = next((s, name) for least, s, name in _UNITS if longest >= least)
    series = []
    for item, times, median in sorted(timed, key=lambda one: one[0].cell.words != ""):
        shown = curve_series.drawn_points(len(times), _MAX_POINTS)
        _, marker = look_of(kind_of(item.cell.representation))
        style = Style(
            colors[item.cell.algo],
            curve_series.line_style(numbers[item.cell.short_name]),
            marker=marker if len(shown) == 1 or not kind.smoothed else "",
        )
        series.append(
            Series(
                times[shown] / size,
                median[shown],
                style,
                item.cell.short_name,
                detail=values.seeds(item.cell),
                entries=(item.cell.short_name,),
                tags=item.cell.tags,
            )
        )
    x = Axis(f"processor time of a seed ({unit})", (0, max(longest, 1e-9) / size))
    return Panel(task, x, curve_series.returns_axis(kind.axis), series, [curve_series.SOLVED_LINE])


def timed_curve(item: LearnedCurve) -> tuple[FloatArray, FloatArray]:
    """Returns the median processor time (s) and the median return at each point.

    The time of a point is that at the center of its window, as for control steps. Only points at
    which every seed has a time count; otherwise the median could decrease. A seed that diverged
    has no time afterwards, and counts only in the return.
    """
    cell, curve = item
    median = _median_times(cell)
    # If some times of a window are missing, the mean of the others is not the time at its center.
    known = centers(np.isfinite(median).astype(np.float64), curve.window) == 1
    usable = known & np.isfinite(curve.quantile(50))
    return centers(median, curve.window)[usable], curve.quantile(50)[usable]


def left_out(cells: Sequence[Cell]) -> list[str]:
    """Returns a sentence on the cells that can't be drawn against processor time, if any."""
    names = [cell.name for cell in cells if not np.isfinite(_median_times(cell)).any()]
    if not names:
        return []
    if len(names) == len(cells):
        return [
            "No cell has the processor times of all its runs, so return against processor time is "
            "not drawn."
        ]
    return [
        "Return against processor time is drawn without these cells, since some of their runs have "
        f"not recorded it: {'; '.join(names)}."
    ]


def _median_times(cell: Cell) -> FloatArray:
    """Returns the median processor time at each point; NaN where a seed has none."""
    times = cell.processor_time[~cell.diverged]
    return np.median(times, axis=0) if len(times) else np.full(times.shape[1], np.nan)


def processor_time_frame(learned: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns the numbers of the figure.

    Columns: task, source, algo, representation, returns (kind), processor_time (s), median.
    """
    parts = []
    for item in learned:
        times, median = timed_curve(item)
        columns = {**item.cell.columns, "processor_time": times, "median": median}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)
