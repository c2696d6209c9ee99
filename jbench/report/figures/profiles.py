"""Performance profiles: the share of runs that end above each return."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jbench.names import TASKS
from jbench.remembered import remembered
from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import scores_of
from jbench.report.data.cells import SOLVED, Cell, in_order, page_tags
from jbench.report.data.curves import FloatArray
from jbench.report.figure import (
    Axis,
    Band,
    Figure,
    Panel,
    ReferenceLine,
    Series,
    Shade,
    Style,
)
from jbench.report.figures.curve_series import (
    KEY_COLOR,
    SOLVED_KEY,
    SOLVED_STYLE,
    details_text,
    line_style,
)
from jbench.report.figures.learning_curves import algorithm_colors
from jbench.report.tables.values import trained
from jbench.wording import counted

THRESHOLDS: FloatArray = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is drawn."""

_RESAMPLES = 1000  # for a band; intervals in tables use more
_ALL = "all tasks together"
_NAMES = ("task", "source", "algo", "representation", "steps")


class _Learner(NamedTuple):
    """What the runs of a line have in common.

    Attributes:
        representation: their representation and the settings of their variant.
        steps: control steps of training.
    """

    source: str
    algo: str
    representation: str
    steps: str
    name: str


def profiles_figure(cells: Sequence[Cell]) -> Figure | None:
    """Returns the performance profiles of cells of one kind of return (Agarwal et al., 2021, 4.2).

    There is a panel per task, and one for all tasks together, with the algorithms and
    representations that were trained on each of them; every task has the same weight. None if no
    seed has a final return.
    """
    groups = _groups(cells)
    if not groups:
        return None
    returns = cells[0].kind
    learners = list(dict.fromkeys(learner for lines in groups.values() for learner in lines))
    learners.sort(key=lambda learner: len(learner.name))  # those with default settings are solid
    colors = algorithm_colors([learner.algo for learner in learners])
    styles: dict[_Learner, Style] = {}
    for learner in learners:
        drawn = sum(other.algo == learner.algo for other in styles)
        styles[learner] = Style(colors[learner.algo], line_style(drawn))
    several = len({learner.name for learner in learners}) < len(learners)
    x = Axis(f"final {returns.name} return", (0, 1000))
    y = Axis("share of runs above", (-0.02, 1.02))
    solved = ReferenceLine(SOLVED, SOLVED_STYLE, vertical=True)
    panels = [
        Panel(
            task,
            x,
            y,
            [_series(task, *line, styles[line[0]], several) for line in lines.items()],
            [solved],
        )
        for task, lines in groups.items()
    ]
    key: list[tuple[str, Style | Shade]] = [
        ("share of runs above", Style(KEY_COLOR)),
        ("95% interval", Shade(KEY_COLOR, 0.2)),
        SOLVED_KEY,
    ]
    note = (
        "Share of runs that end above a return. Runs are better if their line is above another one "
        "everywhere; if lines cross, neither is better in every respect. Bands: uncertainty (95% "
        f"interval, pointwise), for at least {st.MIN_SEEDS} seeds. {returns.final} "
        f"{details_text(panels)}"
    )
    return Figure(f"Performance profiles of final {returns.plural}", panels, key, [note])


def profiles_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns the numbers of the figure.

    Columns: task, source, algo, representation, steps (of training), returns (kind), seeds,
    final_return, share_above.
    """
    parts = [
        pd.DataFrame(
            {
                **dict(zip(_NAMES, (task, *learner[:4]), strict=True)),
                "returns": cells[0].kind.name,
                "seeds": sum(len(seeds) for seeds in strata),
                "final_return": THRESHOLDS,
                "share_above": st.performance_profile(strata, THRESHOLDS),
            }
        )
        for task, lines in _groups(cells).items()
        for learner, strata in lines.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _groups(cells: Sequence[Cell]) -> dict[str, dict[_Learner, list[FloatArray]]]:
    """Returns the final returns by task and learner, with a stratum per task."""
    finals: dict[str, dict[_Learner, list[FloatArray]]] = {}
    tasks = in_order({cell.task for cell in cells}, TASKS)
    for task in tasks:
        for cell in (cell for cell in cells if cell.task == task):
            final = scores_of(cell).final
            if len(final):
                names = cell.source, cell.algo, cell.representation_label
                learner = _Learner(*names, trained(cell).text, cell.short_name)
                finals.setdefault(task, {}).setdefault(learner, []).append(final)
    if len(finals) > 1:
        shared = [k for k in next(iter(finals.values())) if all(k in f for f in finals.values())]
        if shared:
            finals[_ALL] = {k: [f[k][0] for f in finals.values()] for k in shared}
    return finals


def _series(
    task: str, learner: _Learner, strata: Sequence[FloatArray], style: Style, named_steps: bool
) -> Series:
    enough = min(len(seeds) for seeds in strata) >= st.MIN_SEEDS
    share = st.performance_profile(strata, THRESHOLDS)
    bands = [Band(*_interval(strata))] if enough else []
    label = f"{learner.name}, {learner.steps} steps" if named_steps else learner.name
    # The settings of the variant follow the representation.
    representation = learner.representation.partition(",")[0]
    tags = page_tags(learner.algo, representation, learner.source, None if task == _ALL else task)
    detail = _detail(learner, strata)
    more: dict[str, Any] = {"detail": detail, "entries": (label,), "tags": tags}
    return Series(THRESHOLDS, share, style, label, bands, **more)


@remembered
def _interval(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Returns the ends of the 95% interval at each threshold, by the stratified bootstrap.

    The number of n resampled seeds above a threshold has a binomial distribution, so that no seeds
    need to be resampled.
    """
    random = np.random.default_rng(np.random.SeedSequence(0))
    size = _RESAMPLES, len(THRESHOLDS)
    drawn = np.zeros(size)
    for seeds in strata:
        share = st.performance_profile([seeds], THRESHOLDS)
        drawn += random.binomial(len(seeds), share, size) / len(seeds) / len(strata)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return low, high


def _detail(learner: _Learner, strata: Sequence[FloatArray]) -> str:
    runs = sum(len(seeds) for seeds in strata)
    several = f"{counted(runs, 'run')} on {len(strata)} tasks"
    seeds = counted(runs, "seed") if len(strata) == 1 else several
    return f"{seeds}, {learner.steps} control steps"
