"""Learning curves: a grid of tasks as in Figure 9, and comparisons as in Figures 7 and 8."""

from collections.abc import Callable, Hashable, Mapping, Sequence

from jbench.names import ALGORITHMS, FULL, TASKS, Order, kind_of
from jbench.report.data.cells import IMPORTED, Cell, LearnedCurve, in_order
from jbench.report.data.curves import BAND_SEEDS
from jbench.report.data.published import PPO_ENVIRONMENTS, PublishedCurve
from jbench.report.data.returns import TRAINING, Returns
from jbench.report.figure import Axis, Figure, Panel, Series
from jbench.report.figures import curve_series
from jbench.report.figures.curve_series import (
    BAND,
    KEY_COLOR,
    PUBLISHED_KEY,
    QUARTILES,
    SOLVED_LINE,
)
from jbench.report.figures.encoders import look_of
from jbench.report.formatting import display_name
from jbench.report.request import Request
from jbench.report.tables import values

# Okabe and Ito's palette, which is safe for color-blind readers.
ALGORITHM_COLORS = {"ddpg": "#0072B2", "ppo": "#E69F00", "sac": "#009E73", "td3": "#CC79A7"}
_FURTHER_COLORS = ("#56B4E9", "#000000", "#7a3e9d", "#D55E00")
_MUCH_LONGER = 8  # times; see `_steps_axis`

_PPO_NOTE = (
    f"Published PPO curves: their steps are probably those of one of {PPO_ENVIRONMENTS} "
    "environments; ours count the steps of all environments."
)
_CUT_NOTE = "Published curves are shown up to the last step of ours."


def grid_figure(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], request: Request
) -> Figure:
    """Returns a panel per task with a curve per algorithm, as the paper's Figure 9.

    The paper's curves are only drawn with training returns. Encoded observations are drawn here
    only if an algorithm has no runs with the full observation; otherwise they are in the
    comparisons. Sequences of robots are in `sequences`.

    Args:
        learned: our curves of one kind of return, in the order of the paper; at least one.
        published: the paper's curves, and imported ones that are drawn like them.
        request: determines the smoothing, and whether every seed is drawn as well.
    """
    kind = learned[0].cell.kind
    published = _comparable(published, kind)
    present = in_order({cell.task for cell, _ in learned}, TASKS)
    tasks = present if len(present) == 1 else in_order({*present, *TASKS}, TASKS)
    colors = algorithm_colors([cell.algo for cell, _ in learned])
    shown = {task: shown_in_grid(learned, task) for task in tasks}
    numbers = curve_series.line_numbers(cell for items in shown.values() for cell, _ in items)
    panels = [
        _task_panel(task, shown[task], published, colors, numbers, kind, request) for task in tasks
    ]
    notes = [_note(learned, [BAND], panels, request)]
    if any(PUBLISHED_KEY in one.entries for panel in panels for one in panel.series):
        notes.append(
            "Published: Figure 9, training returns, full observation, 10 seeds, quantile-first, "
            f"100 episodes. {_CUT_NOTE}"
        )
        if any(cell.algo == "ppo" for cell, _ in learned):
            notes.append(_PPO_NOTE)
    return Figure(
        f"{kind.name.capitalize()} return while learning the Jitterbug tasks",
        panels,
        curve_series.curve_key(panels, [BAND], each_seed=request.each_seed),
        notes,
    )


def comparison_figures(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], request: Request
) -> dict[tuple[str, str], Figure]:
    """Returns figures of full against encoded observations, as the paper's Figures 7 and 8.

    Args:
        learned: our curves of one kind of return, in the order of the paper.
        published: the paper's curves.
        request: as for `grid_figure`.

    Returns:
        Figures by task and algorithm, for those with several representations or sources, or with a
        published figure.
    """
    figures = {}
    for task, algo in dict.fromkeys((cell.task, cell.algo) for cell, _ in learned):
        ours = [item for item in learned if (item.cell.task, item.cell.algo) == (task, algo)]
        theirs = [
            curve
            for curve in _comparable(published, ours[0].cell.kind)
            if (curve.task, curve.algo) == (task, algo) and curve.figure in ("fig7", "fig8")
        ]
        compared = {(item.cell.representation, item.cell.source) for item in ours}
        if theirs or len(compared) > 1:
            figures[task, algo] = _comparison_figure(ours, theirs, request)
    return figures


def algorithm_colors(algorithms: Sequence[str]) -> dict[str, str]:
    """Returns the fixed colors of the paper's algorithms, and further colors for others."""
    others = in_order(set(algorithms) - set(ALGORITHMS), ())
    further = {name: _FURTHER_COLORS[i % len(_FURTHER_COLORS)] for i, name in enumerate(others)}
    return ALGORITHM_COLORS | further


def shown_in_grid(learned: Sequence[LearnedCurve], task: str) -> list[LearnedCurve]:
    """Returns the curves of a task that `grid_figure` draws."""
    ours = [item for item in learned if item.cell.task == task]
    full = {(c.source, c.algo) for c, _ in ours if c.representation == FULL}
    return [
        item
        for item in ours
        if item.cell.representation == FULL or (item.cell.source, item.cell.algo) not in full
    ]


def _task_panel(
    task: str,
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    colors: Mapping[str, str],
    numbers: Mapping[Hashable, int],
    kind: Returns,
    request: Request,
) -> Panel:
    y = curve_series.returns_axis(kind.axis)
    if not learned:
        return Panel(
            task, Axis("", (0, 1), ticks=()), y, references=[SOLVED_LINE], text="no runs yet"
        )
    series: list[Series] = []
    for algo in dict.fromkeys(item.cell.algo for item in learned):
        same = [item for item in learned if item.cell.algo == algo]
        series += _variants(same, colors[algo], numbers, [BAND], lambda cell: cell.learner, request)
        for curve in published:
            if (curve.figure, curve.task, curve.algo) == ("fig9", task, algo):
                series += curve_series.published_series(
                    curve, colors[algo], BAND, display_name(algo), each_seed=request.each_seed
                )
    for curve in published:
        if (curve.source, curve.task) == (IMPORTED, task):
            label = f"{IMPORTED}: {display_name(curve.algo)} on {curve.representation}"
            series += curve_series.published_series(
                curve, KEY_COLOR, BAND, label, labeled=True, each_seed=request.each_seed
            )
    return Panel(task, _steps_axis(learned), y, series, [SOLVED_LINE])


def _comparison_figure(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], request: Request
) -> Figure:
    task, algo, kind = learned[0].cell.task, learned[0].cell.algo, learned[0].cell.kind
    bands = [QUARTILES, BAND]
    series: list[Series] = []
    ours = list(dict.fromkeys(item.cell.representation for item in learned))
    for representation in ours:
        same = [item for item in learned if item.cell.representation == representation]
        color, _ = look_of(kind_of(representation))
        numbers = curve_series.line_numbers(item.cell for item in same)
        series += _variants(
            same, color, numbers, bands[::-1], lambda cell: cell.representation, request
        )
    for curve in sorted(published, key=lambda curve: curve.representation != FULL):
        color, _ = look_of(kind_of(curve.representation))
        series += curve_series.published_series(
            curve,
            color,
            QUARTILES,
            curve.representation,
            labeled=curve.representation not in ours,
            each_seed=request.each_seed,
        )
    panel = Panel(
        f"{task}, {display_name(algo)}",
        _steps_axis(learned),
        curve_series.returns_axis(kind.axis),
        series,
        [SOLVED_LINE],
    )
    return Figure(
        f"Full against encoded observations: {kind.name} return",
        [panel],
        curve_series.curve_key([panel], bands, each_seed=request.each_seed),
        [_note(learned, bands, [panel], request), *_published_text(published)],
    )


def _variants(
    learned: Sequence[LearnedCurve],
    color: str,
    numbers: Mapping[Hashable, int],
    bands: Sequence[tuple[int, int]],
    name: Callable[[Cell], str],
    request: Request,
) -> list[Series]:
    """Returns curves of one color, with the line style of their number each."""
    series = []
    for item in sorted(learned, key=lambda item: numbers[item.cell.short_name]):
        number = numbers[item.cell.short_name]
        series += curve_series.learned_series(
            item, color, number, bands, name(item.cell), each_seed=request.each_seed
        )
    return series


def _note(
    learned: Sequence[LearnedCurve],
    bands: Sequence[tuple[int, int]],
    panels: Sequence[Panel],
    request: Request,
) -> str:
    """Returns a note on the returns of curves, their averaging, bands and seeds."""
    kind = learned[0].cell.kind
    shown = (
        order_text(request.order, request.window)
        if kind.smoothed
        else "A point is an evaluation, the mean of its episodes for each seed."
    )
    return (
        f"Shown: the {kind.long}. {shown}{values.on_divergence([cell for cell, _ in learned])} "
        f"{band_text(bands)} {curve_series.details_text(panels)}"
    )


def _comparable(published: Sequence[PublishedCurve], kind: Returns) -> Sequence[PublishedCurve]:
    """Returns the imported baselines and, for training returns, the paper's curves."""
    return [curve for curve in published if kind is TRAINING or curve.source == IMPORTED]


def order_text(order: Order, window: int) -> str:
    """Returns a note on the order of quantiles and smoothing."""
    first = (
        "quantiles across seeds per episode, then a moving average"
        if order == "quantile-first"
        else "a moving average per seed, then quantiles across seeds"
    )
    return (
        f"Order: {order}, {first}. Window: {window} episodes, but at most a quarter of the longest "
        "run; it shrinks to half of that at the first and the last episode."
    )


def band_text(bands: Sequence[tuple[int, int]]) -> str:
    """Returns a note on the bands."""
    names = " and, lighter, ".join(curve_series.percentiles(band) for band in bands)
    return (
        f"Bands: {names} across seeds (spread, not a confidence interval), for at least "
        f"{BAND_SEEDS} seeds."
    )


def _published_text(published: Sequence[PublishedCurve]) -> list[str]:
    texts = {
        "fig7": "Published Figure 7: training returns, one seed each (no spread), unknown "
        "smoothing.",
        "fig8": "Published Figure 8: training returns, 10 seeds, smooth-first, 100 episodes; this "
        "order gives narrower bands than quantile-first.",
    }
    return [f"{texts[figure]} {_CUT_NOTE}" for figure in sorted({c.figure for c in published})]


def _steps_axis(learned: Sequence[LearnedCurve]) -> Axis:
    """Returns the axis of control steps up to the end of the longest run.

    It is logarithmic for evaluations of runs with very different lengths, because short runs would
    fill only the left end of a linear axis. It is linear for training returns, as in the paper, and
    if there is an evaluation at control step 0.
    """
    ends = [cell.longest for cell, _ in learned]
    first = min(float(curve.control_steps[0]) for _, curve in learned)
    long = max(ends) >= _MUCH_LONGER * min(ends)
    if learned[0].cell.kind.smoothed or not (long and first > 0):
        return curve_series.steps_axis(max(ends))
    return Axis("control steps (thousands, logarithmic)", (first, max(ends)), log=True, unit=1e-3)
