"""Performance profiles: the share of runs that end above each return."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.names import TASKS
from jbench.remembered import remembered
from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import scores_of
from jbench.report.data.cells import SOLVED, Cell, in_order, page_tags
from jbench.report.data.curves import FloatArray
from jbench.report.figure import Axis, Band, Figure, Panel, ReferenceLine, Series, Shade, Style
from jbench.report.figures.curve_series import (
    KEY_COLOR,
    SOLVED_KEY,
    SOLVED_STYLE,
    details_text,
    line_numbers,
    line_style,
)
from jbench.report.figures.learning_curves import algorithm_colors
from jbench.report.tables.values import trained
from jbench.wording import counted

THRESHOLDS: FloatArray = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is drawn."""

_RESAMPLES = 1000  # for a band; intervals in tables use more
_ALL = "all tasks together"

_Line = tuple[str, str]
"""Name of a learner within a task, and the control steps that it was trained for."""


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
    drawn = [cell for lines in groups.values() for of_line in lines.values() for cell in of_line]
    colors, numbers = algorithm_colors([cell.algo for cell in drawn]), line_numbers(drawn, _line)
    styles = {_line(c): Style(colors[c.algo], line_style(numbers[_line(c)])) for c in drawn}
    several = len({name for name, _ in styles}) < len(styles)
    x = Axis(f"final {returns.name} return", (0, 1000))
    y = Axis("share of runs above", (-0.02, 1.02))
    solved = ReferenceLine(SOLVED, SOLVED_STYLE, vertical=True)
    panels = [
        Panel(
            task,
            x,
            y,
            [_series(task, of_line, styles[line], several) for line, of_line in lines.items()],
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
                "task": task,
                "source": of_line[0].source,
                "algo": of_line[0].algo,
                "representation": of_line[0].representation_label,
                "steps": steps,
                "returns": of_line[0].kind.name,
                "seeds": sum(map(len, _strata(of_line))),
                "final_return": THRESHOLDS,
                "share_above": st.performance_profile(_strata(of_line), THRESHOLDS),
            }
        )
        for task, lines in _groups(cells).items()
        for (_, steps), of_line in lines.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _line(cell: Cell) -> _Line:
    return cell.short_name, trained(cell).text


def _strata(cells: Sequence[Cell]) -> list[FloatArray]:
    """Returns the final returns of cells of different tasks, a stratum each."""
    return [scores_of(cell).final for cell in cells]


def _groups(cells: Sequence[Cell]) -> dict[str, dict[_Line, list[Cell]]]:
    """Returns the cells of each line by task, and those of the lines on all tasks together."""
    groups: dict[str, dict[_Line, list[Cell]]] = {}
    for task in in_order({cell.task for cell in cells}, TASKS):
        for cell in cells:
            if cell.task == task and len(scores_of(cell).final):
                groups.setdefault(task, {}).setdefault(_line(cell), []).append(cell)
    if len(groups) > 1:
        first, *others = groups.values()
        shared = [line for line in first if all(line in lines for lines in others)]
        if shared:
            groups[_ALL] = {line: [lines[line][0] for lines in groups.values()] for line in shared}
    return groups


def _series(task: str, cells: Sequence[Cell], style: Style, named_steps: bool) -> Series:
    strata, cell = _strata(cells), cells[0]
    name, steps = _line(cell)
    enough = min(map(len, strata)) >= st.MIN_SEEDS
    runs = counted(sum(map(len, strata)), "run")
    seeds = f"{runs} on {len(strata)} tasks" if len(strata) > 1 else counted(len(strata[0]), "seed")
    label = f"{name}, {steps} steps" if named_steps else name
    return Series(
        THRESHOLDS,
        st.performance_profile(strata, THRESHOLDS),
        style,
        label,
        [Band(*_interval(strata))] if enough else [],
        detail=f"{seeds}, {steps} control steps",
        entries=(label,),
        tags=page_tags(cell.algo, cell.representation, cell.source, None if task == _ALL else task),
    )


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
