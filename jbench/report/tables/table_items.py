"""The tables of a report, as a reader wants them; the exact numbers are in files beside."""

from collections.abc import Sequence

import pandas as pd

from jbench.names import FULL, TASKS
from jbench.report import formatting
from jbench.report.analysis.comparisons import Comparison, best_of
from jbench.report.analysis.scores import SPREADS
from jbench.report.analysis.statistics import DECIDING_SEEDS, LEAST_SEEDS
from jbench.report.data.cells import SOLVED, Cell, in_order
from jbench.report.data.published import PublishedCurve
from jbench.report.data.returns import TRAINING
from jbench.report.data.summaries import published_beside
from jbench.report.document import TableItem, Value
from jbench.report.formatting import display_name
from jbench.report.tables import values
from jbench.report.views import View

_INTERVAL = (
    f"In brackets the uncertainty (95% interval, from {LEAST_SEEDS} seeds up): how far the number "
    f"could be off, since it is of a sample of seeds. Of fewer than {DECIDING_SEEDS} seeds it is "
    "too narrow and decides nothing. It is not the spread between seeds."
)
_AT_COMMON_STEP = "at the last control step that every seed of both has reached"
_STEPS = (
    "Control steps are those that a cell was trained for: rows of different numbers of them are "
    "not comparable."
)
_HALF = "half the published best"
_SPREAD_NAMES = {
    "ten_to_ninety": "10th\N{EN DASH}90th",
    "interquartile_range": "25th\N{EN DASH}75th",
    "standard_deviation": "standard deviation",
}


def final_returns(view: View) -> TableItem:
    """Returns the table for a paper: a row for each algorithm and observation, a column a task."""
    cells = view.cells
    tasks = in_order({cell.task for cell in cells}, TASKS)
    best = [best_of([c for c in cells if c.task == task and c.robots <= 1]) for task in tasks]
    rows: dict[tuple[object, ...], dict[str, object]] = {}
    for cell, named in zip(cells, values.names(cells, task=False), strict=True):
        steps = values.trained(cell)
        row = rows.setdefault((*named.values(), steps.text), {**named, "control steps": steps})
        row[cell.task] = values.spread(cell, best=any(cell is one for one in best))
    heading = [name for name in next(iter(rows.values())) if name not in tasks] + tasks
    return TableItem(
        view.file("final_returns"),
        f"Final {view.kind.plural}",
        f"Median final {view.kind.name} return across seeds [10th, 90th percentile: spread], and "
        f"the number of seeds n. {view.kind.final} {_STEPS} Bold: the median is above that of "
        "every other row, with the 95% interval of each difference above 0, at the last control "
        f"step that both have, from {DECIDING_SEEDS} seeds each; where nothing is bold, the data "
        f"name no best one.{_divergence(cells)}",
        pd.DataFrame(list(rows.values()), columns=heading),
    )


def returns_of_cells(view: View, published: Sequence[PublishedCurve]) -> TableItem:
    """Returns the table of final returns with what is uncertain of them."""
    rows = []
    for named, summary in zip(values.names(view.cells), view.statistics, strict=True):
        cell, location = summary.cell, summary.get("final_return", "interquartile_mean")
        rows.append(
            {
                **named,
                "n": location.seeds if location else 0,
                "diverged": _diverged(cell),
                "control steps": values.trained(cell),
                f"final {view.kind.name} return: median": values.of_statistic(
                    summary.get("final_return", "median")
                ),
                f"final {view.kind.name} return: IQM": values.of_statistic(location),
                f"{view.kind.name} return over the run: IQM": values.of_statistic(
                    summary.get("area", "interquartile_mean")
                ),
                "published median (training return)": _published(cell, published),
            }
        )
    theirs = " The published median is the paper's best at the same number of control steps."
    return TableItem(
        view.file("statistics"),
        f"Final {view.kind.name} return, and {view.kind.name} return over the run",
        f"{view.kind.final} The return over the run, the area under the learning curve, is "
        f"{view.kind.over_run}. {_STEPS} The interquartile mean (IQM) is the mean without the "
        f"lowest and highest quarter of seeds. {_INTERVAL}"
        f"{theirs if view.kind is TRAINING else ''}{_divergence(view.cells)}",
        pd.DataFrame(rows).dropna(axis="columns", how="all"),
    )


def _divergence(cells: Sequence[Cell]) -> str:
    """Says how diverged seeds count, if there are any."""
    if not any(cell.diverged.any() for cell in cells):
        return ""
    return " From its divergence on, a seed that diverged counts with return 0, the least possible."


def _diverged(cell: Cell) -> Value | None:
    if not cell.diverged.any():
        return None
    count, seeds = int(cell.diverged.sum()), len(cell.seeds)
    return Value(f"{count} of {seeds}", count / seeds, numbers={"": count, "of": seeds})


def _published(cell: Cell, published: Sequence[PublishedCurve]) -> Value | None:
    found = published_beside(cell, published)
    if found is None:
        return None
    median, figure = found
    name = figure.replace("fig", "Figure ")
    return Value(f"{median:.0f} ({name})", median)


def spreads(view: View) -> TableItem | None:
    """Returns the table of how much seeds differ; None where no cell has two."""
    found = [one for one in view.statistics if one.get("final_return", "standard_deviation")]
    if not found:
        return None
    rows = []
    for named, summary in zip(values.names([s.cell for s in found]), found, strict=True):
        one = summary.get("final_return", "standard_deviation")
        row: dict[str, object] = {**named, "n": one.seeds if one else 0}
        row["control steps"] = values.trained(summary.cell)
        for name in SPREADS:
            said = _SPREAD_NAMES[name]
            row[said] = values.of_statistic(summary.get("final_return", name))
        for name in SPREADS:
            said = f"{_SPREAD_NAMES[name]}, as a multiple of {FULL}'s"
            row[said] = values.of_statistic(
                summary.get("final_return", f"{name}_ratio"), formatting.ratio
            )
        rows.append(row)
    return TableItem(
        view.file("spread"),
        f"Spread of the final {view.kind.name} return between seeds",
        f"How far the final {view.kind.plural} of seeds lie apart: the width of the band from the "
        "10th to the 90th percentile, of that from the 25th to the 75th, and the standard "
        "deviation; then each as a multiple of that of the same algorithm on the full "
        f"observation, {_AT_COMMON_STEP} ({view.kind.up_to}). {_INTERVAL}",
        pd.DataFrame(rows).dropna(axis="columns", how="all"),
    )


def learning_speed(view: View) -> TableItem | None:
    """Returns the table of control steps to a return; None where no cell has any."""
    timed = [summary for summary in view.statistics if summary.get("steps_to_solved", "median")]
    if not timed:
        return None
    rows = []
    for named, summary in zip(values.names([s.cell for s in timed]), timed, strict=True):
        row: dict[str, object] = {**named, "trained for": values.trained(summary.cell)}
        half = summary.get("steps_to_half_best", "median")
        goals = {"steps_to_solved": str(SOLVED), "steps_to_half_best": _HALF}
        for measure, goal in goals.items():
            median = summary.get(measure, "median")
            if goal == _HALF:
                row[_HALF] = half and round(half.threshold or 0)
            row |= {
                f"seeds that reach {goal}": values.reached(median),
                f"control steps to {goal}: median": values.of_statistic(median, formatting.steps),
                f"control steps to {goal}: IQM": values.of_statistic(
                    summary.get(measure, "interquartile_mean"), formatting.steps
                ),
            }
        rows.append(row)
    what = (
        "the moving average of a seed's training returns first reaches a value: the centre of that "
        "window, which is whole"
        if view.kind.smoothed
        else "an evaluation of a seed first reaches a value"
    )
    return TableItem(
        view.file("learning_speed"),
        f"Control steps to a value of the {view.kind.name} return",
        f"When {what}, in control steps over all environments. Seeds that never do are not left "
        f'out: they count as later than all others, and "{formatting.NOT_REACHED}" says that half '
        "of the seeds, or an end of the interval, lies there. A run that has not ended may still "
        "do. "
        f"{_INTERVAL}{_divergence(view.cells)}",
        pd.DataFrame(rows).dropna(axis="columns", how="all"),
    )


def comparisons(view: View) -> TableItem | None:
    """Returns the table of cells beside each other; None where there is nothing to compare."""
    if not view.comparisons:
        return None
    rows = []
    for one in view.comparisons:
        seeds = {"this": one.seeds[0], "other": one.seeds[1]}
        rows.append(
            {
                "task": one.ours.task,
                "this": _named(one, "ours"),
                "against": _named(one, "theirs"),
                "n": Value(f"{one.seeds[0]}, {one.seeds[1]}", min(one.seeds), numbers=seeds),
                "at control step": _steps(one.control_steps),
                "probability of improvement": values.estimate(one.improvement, formatting.ratio),
                f"difference of IQMs of the final {view.kind.name} return": values.estimate(
                    one.difference, formatting.signed
                ),
                "control steps not compared": _steps(one.cut) if one.cut else None,
            }
        )
    return TableItem(
        view.file("comparisons"),
        f"Comparisons of final {view.kind.plural}",
        "The probability that a run of this ends above one of the other (0.5: no difference), and "
        f"by how much its interquartile mean is higher: of final {view.kind.plural} "
        f"{_AT_COMMON_STEP} ({view.kind.up_to}). {_INTERVAL} Each interval stands for itself: of "
        "20 comparisons of equals, one is expected to look like a difference.",
        pd.DataFrame(rows).dropna(axis="columns", how="all"),
    )


def _steps(control_steps: int) -> Value:
    return Value(formatting.steps(control_steps), control_steps)


def _named(one: Comparison, which: str) -> str:
    cell = one.ours if which == "ours" else one.theirs
    name = f"{display_name(cell.algo)}, {cell.seen}"
    return f"{cell.prefix}{name}"


def _number(value: float) -> str:
    """Returns a number as the table of encoders shows it; nothing for one that is not known."""
    return "" if value != value else f"{value:.4f}"


def encoder_errors(table: pd.DataFrame) -> TableItem:
    """Returns the table of what encoders lose."""
    names = {
        **{"task": "task", "kind": "kind", "settings": "settings", "latents": "latents"},
        **{"seeds": "n", "test": "not explained", "pca": "PCA's", "random": "random projection's"},
        **{"heuristic": "on the heuristic's episodes", "pca_heuristic": "PCA's there"},
        **{"yaw_rate": "R² of yaw rate", "forward_speed": "forward speed"},
        **{"tilt_rate": "tilt rate", "reward": "reward", "effective_rank": "effective rank"},
    }
    shown = table[list(names)].rename(columns=names)
    for name in list(names.values())[5:]:
        cells = [Value(_number(value), float(value)) for value in shown[name]]
        shown[name] = pd.Series(cells, shown.index, dtype=object)
    if not any(shown["settings"]):
        shown = shown.drop(columns="settings")
    return TableItem(
        "encoder_errors",
        "What encoders lose",
        "The fraction of the variance of the scaled features that an encoder does not give back, "
        "on held-out episodes of its dataset and on episodes of the task's hand-written policy; "
        "beside it PCA and a random projection of the same size, on the same states. R² is of the "
        "next control step, predicted on held-out episodes by a small network from latents and "
        "action. Medians across the seeds of the encoders.",
        shown,
    )
