"""Learning curves: a grid of tasks as in Figure 9, and comparisons as in Figures 7 and 8."""

from collections.abc import Sequence

import numpy as np

from jbench.names import ALGORITHMS, FULL, TASKS, Order, kind_of
from jbench.report.data.cells import IMPORTED, LearnedCurve, in_order
from jbench.report.data.curves import BAND_SEEDS
from jbench.report.data.published import PPO_ENVIRONMENTS, PublishedCurve
from jbench.report.data.returns import TRAINING, Returns
from jbench.report.figure import Axis, Figure, Panel, Series
from jbench.report.figures import curve_series
from jbench.report.figures.encoders import look_of
from jbench.report.formatting import display_name

# Okabe and Ito's palette, which is safe for color-blind readers.
ALGORITHM_COLORS = {"ddpg": "#0072B2", "ppo": "#E69F00", "sac": "#009E73", "td3": "#CC79A7"}
_FURTHER_COLORS = ("#56B4E9", "#000000", "#7a3e9d", "#D55E00")

_PPO_NOTE = (
    f"Published PPO curves: their steps are probably those of one of {PPO_ENVIRONMENTS} "
    "environments; ours count the steps of all environments."
)
_CUT_NOTE = "Published curves are shown up to the last step of ours."


def grid_figure(
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    order: Order,
    window: int,
    *,
    each_seed: bool = False,
) -> Figure:
    """Returns a panel per task with a curve per algorithm, as the paper's Figure 9.

    The paper's curves are only drawn with training returns. Encoded observations are drawn here
    only if an algorithm has no runs with the full observation; otherwise they are in the
    comparisons. Sequences of robots are in `sequences`.

    Args:
        learned: our curves of one kind of return, in the order of the paper; at least one.
        published: the paper's curves.
        order: order of quantiles and smoothing.
        window: requested number of episodes in a moving average.
        each_seed: whether every seed is drawn as well.
    """
    kind = learned[0].cell.kind
    published = _comparable(published, kind)
    present = in_order({cell.task for cell, _ in learned}, TASKS)
    tasks = present if len(present) == 1 else in_order({*present, *TASKS}, TASKS)
    colors = algorithm_colors([cell.algo for cell, _ in learned])
    panels = [
        _task_panel(task, shown_in_grid(learned, task), published, colors, kind, each_seed)
        for task in tasks
    ]
    notes = [
        f"{curve_text(learned, order, window)} {band_text([(10, 90)])} "
        f"{curve_series.details_text(panels)}"
    ]
    if kind is TRAINING:
        notes.append(
            f"Published: Figure 9, training returns, full observation, 10 seeds, quantile-first, "
            f"100 episodes. {_CUT_NOTE}"
        )
    if kind is TRAINING and any(cell.algo == "ppo" for cell, _ in learned):
        notes.append(_PPO_NOTE)
    return Figure(
        f"{kind.name.capitalize()} return while learning the Jitterbug tasks",
        panels,
        curve_series.curve_key(panels, [(10, 90)], each_seed=each_seed, whose=_whose(learned)),
        notes,
    )


def comparison_figures(
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    order: Order,
    window: int,
    *,
    each_seed: bool = False,
) -> dict[tuple[str, str], Figure]:
    """Returns figures of full against encoded observations, as the paper's Figures 7 and 8.

    Args:
        learned: our curves of one kind of return, in the order of the paper.
        published: the paper's curves.
        order: order of quantiles and smoothing.
        window: requested number of episodes in a moving average.
        each_seed: whether every seed is drawn as well.

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
        kinds = {(item.cell.representation, item.cell.source) for item in ours}
        if theirs or len(kinds) > 1:
            figures[task, algo] = _comparison_figure(ours, theirs, order, window, each_seed)
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
    colors: dict[str, str],
    kind: Returns,
    each_seed: bool,
) -> Panel:
    y = curve_series.returns_axis(kind.axis)
    if not learned:
        x = Axis("", (0, 1), ticks=())
        return Panel(task, x, y, references=[curve_series.SOLVED_LINE], text="no runs yet")
    series: list[Series] = []
    for algo in dict.fromkeys(item.cell.algo for item in learned):
        # The variant without words, which has the defaults, is solid.
        same = sorted(
            (item for item in learned if item.cell.algo == algo),
            key=lambda item: item.cell.words != "",
        )
        for style, item in enumerate(same):
            look = curve_series.Look(colors[algo], style)
            series += curve_series.learned_series(
                item, look, ((10, 90),), item.cell.learner, each_seed=each_seed
            )
        for curve in published:
            if (curve.figure, curve.task, curve.algo) == ("fig9", task, algo):
                series += curve_series.published_series(
                    curve, colors[algo], (10, 90), display_name(algo), each_seed=each_seed
                )
    series += _baseline_series(published, task, (10, 90), each_seed)
    return Panel(
        task, curve_series.steps_axis(_end(learned)), y, series, [curve_series.SOLVED_LINE]
    )


def _comparison_figure(
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    order: Order,
    window: int,
    each_seed: bool,
) -> Figure:
    task, algo, kind = learned[0].cell.task, learned[0].cell.algo, learned[0].cell.kind
    bands = [(25, 75), (10, 90)]
    series: list[Series] = []
    ours = list(dict.fromkeys(item.cell.representation for item in learned))
    for representation in ours:
        same = [item for item in learned if item.cell.representation == representation]
        for style, item in enumerate(sorted(same, key=lambda item: item.cell.words != "")):
            look = curve_series.Look(look_of(kind_of(representation))[0], style)
            series += curve_series.learned_series(
                item, look, bands[::-1], representation, each_seed=each_seed
            )
    for curve in sorted(published, key=lambda curve: curve.representation != FULL):
        series += curve_series.published_series(
            *(curve, look_of(kind_of(curve.representation))[0], (25, 75), curve.representation),
            labelled=curve.representation not in ours,
            each_seed=each_seed,
        )
    panel = Panel(
        f"{task}, {display_name(algo)}",
        curve_series.steps_axis(_end(learned)),
        curve_series.returns_axis(kind.axis),
        series,
        [curve_series.SOLVED_LINE],
    )
    return Figure(
        f"Full against encoded observations: {kind.name} return",
        [panel],
        curve_series.curve_key([panel], bands, each_seed=each_seed, whose=_whose(learned)),
        [
            f"{curve_text(learned, order, window)} {band_text(bands)} "
            f"{curve_series.details_text([panel])}",
            *_published_text(published),
        ],
    )


def _comparable(published: Sequence[PublishedCurve], kind: Returns) -> Sequence[PublishedCurve]:
    """Returns the baselines, and the paper's curves with our training returns, which they are."""
    return [curve for curve in published if kind is TRAINING or curve.source == IMPORTED]


def _baseline_series(
    published: Sequence[PublishedCurve], task: str, band: tuple[int, int], each_seed: bool
) -> list[Series]:
    """Returns the imported curves of a task that are drawn as published ones."""
    series: list[Series] = []
    for curve in published:
        if (curve.source, curve.task) == (IMPORTED, task):
            label = f"{IMPORTED}: {display_name(curve.algo)} on {curve.representation}"
            series += curve_series.published_series(
                *(curve, curve_series.KEY_COLOR, band, label),
                labelled=True,
                each_seed=each_seed,
            )
    return series


def curve_text(learned: Sequence[LearnedCurve], order: Order, window: int) -> str:
    """Returns a note on the returns of curves and their averaging."""
    kind = learned[0].cell.kind
    shown = f"Shown: the {kind.long}."
    diverged = (
        " A seed that diverged counts with return 0 from then on."
        if any(item.cell.diverged.any() for item in learned)
        else ""
    )
    if not kind.smoothed:
        return (
            f"{shown} A point is an evaluation, the mean of its episodes for each seed.{diverged}"
        )
    return f"{shown} {order_text(order, window)}{diverged}"


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


def _whose(learned: Sequence[LearnedCurve]) -> str:
    """Returns how the key names the curves that are not published."""
    return IMPORTED if all(item.cell.source == IMPORTED for item in learned) else "ours"


def _end(learned: Sequence[LearnedCurve]) -> float:
    ends = [float(np.nanmax(item.cell.control_steps)) for item in learned]
    return max(ends, default=1.0)
