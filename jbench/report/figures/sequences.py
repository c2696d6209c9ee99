"""Training on a sequence of augmented robots, compared with the authors' sequence."""

from collections.abc import Sequence

from jbench.report.data.cells import LearnedCurve
from jbench.report.data.published import SEQUENCE_ROBOTS, PublishedCurve
from jbench.report.figure import Figure, Panel, ReferenceLine, Series, Style
from jbench.report.figures import curve_series
from jbench.report.figures.curve_series import BAND, SOLVED_LINE
from jbench.report.figures.learning_curves import ALGORITHM_COLORS, band_text, order_text
from jbench.report.formatting import display_name
from jbench.report.request import Request
from jbench.report.views import SEQUENCE_WINDOW


def sequence_figures(
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    request: Request,
) -> dict[tuple[str, str], Figure]:
    """Returns the figures of cells with several robots, by task and algorithm.

    Args:
        learned: our curves of training returns on several robots, each robot's episodes averaged
            separately.
        published: the paper's curves; those with several robots are drawn.
        request: determines the order of smoothing, and whether every seed is drawn as well.
    """
    figures = {}
    for task, algo in dict.fromkeys((cell.task, cell.algo) for cell, _ in learned):
        ours = [item for item in learned if (item.cell.task, item.cell.algo) == (task, algo)]
        theirs = [c for c in published if c.sequence and (c.task, c.algo) == (task, algo)]
        figures[task, algo] = _figure(ours, theirs, request)
    return figures


def _figure(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], request: Request
) -> Figure:
    cells = [item.cell for item in learned]
    task, algo = cells[0].task, cells[0].algo
    end = max(cell.longest for cell in cells)
    color = ALGORITHM_COLORS.get(algo, "#000000")
    series: list[Series] = []
    for nth, item in enumerate(learned):
        name = f"{item.cell.representation}, {item.cell.robots} robots"
        series += curve_series.learned_series(
            item, color, nth, [BAND], name, each_seed=request.each_seed
        )
    for curve in published:
        name = f"{curve.representation}, {SEQUENCE_ROBOTS} robots"
        series += curve_series.published_series(
            curve, color, BAND, name, labeled=True, each_seed=request.each_seed
        )
    switches = {
        switch * cell.robot_episodes * cell.longest / cell.returns.shape[1]
        for cell in cells
        for switch in range(1, cell.robots)
    }
    changes = [
        ReferenceLine(steps, Style("0.75", width=0.7), vertical=True) for steps in sorted(switches)
    ]
    notes = [
        f"Shown: the {cells[0].kind.long}. "
        f"{order_text(request.order, SEQUENCE_WINDOW)} {band_text([BAND])}",
        "Gray lines: switch to the next robot; averages are within one robot's episodes.",
    ]
    if published:
        notes.append(
            f"Published: SAC on {SEQUENCE_ROBOTS} other robots, 1e6 control steps on each, a "
            f"window of {SEQUENCE_WINDOW} episodes; shown up to the last step of ours."
        )
    panel = Panel(
        f"{task}, {display_name(algo)}, sequence of augmented robots",
        curve_series.steps_axis(end),
        curve_series.returns_axis(cells[0].kind.axis),
        series,
        [SOLVED_LINE, *changes],
    )
    key = curve_series.curve_key([panel], [BAND], each_seed=request.each_seed)
    return Figure("Training on a sequence of robots", [panel], key, notes)
