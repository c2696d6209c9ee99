"""Performance profiles: which share of runs ends above any return one may ask for."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.names import TASKS
from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import scores_of
from jbench.report.data.cells import OURS, SOLVED, Cell, in_order
from jbench.report.data.curves import FloatArray
from jbench.report.figure import (
    Axis,
    Band,
    Dash,
    Figure,
    Panel,
    ReferenceLine,
    Series,
    Shade,
    Style,
)
from jbench.report.figures.curve_series import KEY_COLOR, LINE_STYLES, SOLVED_KEY, SOLVED_STYLE
from jbench.report.figures.learning_curves import algorithm_colors
from jbench.report.formatting import display_name
from jbench.report.tables.values import trained

THRESHOLDS: FloatArray = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is drawn."""

_RESAMPLES = 1000  # for a band; an interval in a table has more
_ALL = "all tasks together"
_NAMES = ("task", "source", "algo", "representation", "steps")

_Kind = tuple[str, str, str, str]
"""Source, algorithm, what is seen, and for how many control steps the seeds were trained."""


def profiles_figure(cells: Sequence[Cell]) -> Figure | None:
    """Returns the performance profiles of cells of one kind of return (Agarwal et al., 2021, 4.2).

    A panel for each task, and one for all tasks together with those algorithms and representations
    that have learned each of them; there, every task counts the same. None where no seed of these
    cells has a final return.
    """
    groups = _groups(cells)
    if not groups:
        return None
    returns = cells[0].kind
    kinds = list(dict.fromkeys(kind for lines in groups.values() for kind in lines))
    colors = algorithm_colors([algo for _, algo, _, _ in kinds])
    styles = {
        kind: Style(colors[kind[1]], _dash([one for one in kinds if one[1] == kind[1]], kind))
        for kind in kinds
    }
    x = Axis(f"final {returns.name} return", (0, 1000))
    y = Axis("share of runs above", (-0.02, 1.02))
    solved = ReferenceLine(SOLVED, SOLVED_STYLE, vertical=True)
    panels = [
        Panel(task, x, y, [_series(*line, styles[line[0]]) for line in lines.items()], [solved])
        for task, lines in groups.items()
    ]
    key: list[tuple[str, Style | Shade]] = [
        ("share of runs that end above a return", Style(KEY_COLOR)),
        ("its uncertainty (95% interval)", Shade(KEY_COLOR, 0.2)),
        SOLVED_KEY,
    ]
    note = (
        "Read upwards from a return: the share of runs that end above it. A line above another "
        "everywhere belongs to the better runs; lines that cross are better in different ways. "
        f"Bands: uncertainty (95% interval) at each return alone, drawn from {st.LEAST_SEEDS} "
        f"seeds up. {returns.final} Runs end after the number of control steps in the legend."
    )
    return Figure(f"Performance profiles of final {returns.plural}", panels, key, [note])


def profiles_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns what is drawn.

    Columns: task, source, algo, representation, steps (trained for), returns (their kind), seeds,
    final_return, share_above.
    """
    parts = [
        pd.DataFrame(
            {
                **dict(zip(_NAMES, (task, *kind), strict=True)),
                "returns": cells[0].kind.name,
                "seeds": sum(len(seeds) for seeds in strata),
                "final_return": THRESHOLDS,
                "share_above": st.performance_profile(strata, THRESHOLDS),
            }
        )
        for task, lines in _groups(cells).items()
        for kind, strata in lines.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _groups(cells: Sequence[Cell]) -> dict[str, dict[_Kind, list[FloatArray]]]:
    """Returns the final returns by task and kind; a stratum for each task."""
    finals: dict[str, dict[_Kind, list[FloatArray]]] = {}
    tasks = in_order({cell.task for cell in cells}, TASKS)
    for task in tasks:
        for cell in (cell for cell in cells if cell.task == task):
            final = scores_of(cell).final
            if len(final):
                kind = cell.source, cell.algo, cell.seen, trained(cell).text
                finals.setdefault(task, {}).setdefault(kind, []).append(final)
    if len(finals) > 1:
        shared = [k for k in next(iter(finals.values())) if all(k in f for f in finals.values())]
        if shared:
            finals[_ALL] = {k: [f[k][0] for f in finals.values()] for k in shared}
    return finals


def _dash(kinds: Sequence[_Kind], kind: _Kind) -> Dash:
    return LINE_STYLES[kinds.index(kind) % len(LINE_STYLES)]


def _series(kind: _Kind, strata: Sequence[FloatArray], style: Style) -> Series:
    enough = min(len(seeds) for seeds in strata) >= st.LEAST_SEEDS
    share = st.performance_profile(strata, THRESHOLDS)
    bands = [Band(*_interval(strata))] if enough else []
    return Series(THRESHOLDS, share, style, _label(kind, strata), bands)


def _interval(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Returns the ends of the 95% interval at each threshold, by the stratified bootstrap.

    At one threshold, how many of n resampled seeds lie above it is a binomial number, so that no
    seeds need to be drawn.
    """
    random = np.random.default_rng(np.random.SeedSequence(0))
    size = _RESAMPLES, len(THRESHOLDS)
    drawn = np.zeros(size)
    for seeds in strata:
        share = st.performance_profile([seeds], THRESHOLDS)
        drawn += random.binomial(len(seeds), share, size) / len(seeds) / len(strata)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return low, high


def _label(kind: _Kind, strata: Sequence[FloatArray]) -> str:
    source, algo, seen, steps = kind
    runs = sum(len(seeds) for seeds in strata)
    counted = f"{runs} seeds" if len(strata) == 1 else f"{runs} runs on {len(strata)} tasks"
    name = f"{display_name(algo)}, {seen}, {steps} steps ({'1 seed' if runs == 1 else counted})"
    return name if source == OURS else f"{source}: {name}"
