"""Tables of a report with formatted numbers; the exact numbers are in data files."""

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from jbench.names import FULL, TASKS
from jbench.report import formatting
from jbench.report.analysis.comparisons import best_of
from jbench.report.analysis.scores import BY_EPISODES, SPREADS, Summary
from jbench.report.analysis.statistics import DECIDING_SEEDS, MIN_SEEDS
from jbench.report.data.cells import SOLVED, Cell, in_order, verified
from jbench.report.data.published import PublishedCurve, name_of_figure
from jbench.report.data.returns import TRAINING
from jbench.report.data.summaries import published_beside
from jbench.report.document import TableItem, Value
from jbench.report.tables import values
from jbench.report.tables.values import of_statistic
from jbench.report.views import View

_INTERVAL = (
    f"In brackets the uncertainty due to the sample of seeds (95% interval, from {MIN_SEEDS} seeds "
    f"up); with fewer than {DECIDING_SEEDS} seeds the interval is too narrow and decides nothing. "
    "It is not the spread between seeds."
)
_AT_COMMON_STEP = "at the last control step that every seed of both has reached"
_STEPS = (
    "Control steps are those of training: rows with different numbers of control steps are not "
    "comparable."
)
_HALF = "half the published best"
_SPREAD_NAMES = {
    "ten_to_ninety": "10th\N{EN DASH}90th",
    "interquartile_range": "25th\N{EN DASH}75th",
    "standard_deviation": "standard deviation",
}

_BY_EPISODES = "standard deviation by episodes alone"


def final_returns(view: View) -> TableItem:
    """Returns the main table: a row per algorithm and observation, a column per task."""
    cells = view.cells
    tasks = in_order({cell.task for cell in cells}, TASKS)
    ranked = [cell for cell in verified(cells) or cells if cell.robots <= 1]
    best = [best_of([cell for cell in ranked if cell.task == task]) for task in tasks]
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
        f"step that both have reached, with at least {DECIDING_SEEDS} seeds each; if nothing is "
        f"bold, no row is best.{_unranked(cells)}{_divergence(cells)}",
        pd.DataFrame(list(rows.values()), columns=heading),
    )


def returns_of_cells(view: View, published: Sequence[PublishedCurve]) -> TableItem:
    """Returns the table of final returns with their uncertainty."""
    kind = view.kind
    final, over_run = f"final {kind.name} return", f"{kind.name} return over the run"
    rows = []
    for named, summary in zip(values.names(view.cells), view.statistics, strict=True):
        cell, location = summary.cell, summary.get("final_return", "interquartile_mean")
        rows.append(
            {
                **named,
                "n": location.seeds if location else 0,
                "diverged": _diverged(cell),
                "control steps": values.trained(cell),
                f"{final}: median": of_statistic(summary, "final_return", "median"),
                f"{final}: IQM": of_statistic(summary, "final_return", "interquartile_mean"),
                f"{over_run}: IQM": of_statistic(summary, "area", "interquartile_mean"),
                "published median (training return)": _published(cell, published),
            }
        )
    published_note = (
        " The published median is read in the middle of the episodes of the final return; of "
        "several published curves, it is that of the highest."
    )
    return TableItem(
        view.file("statistics"),
        f"Final {kind.name} return, and {over_run}",
        f"{kind.final} The return over the run, the area under the learning curve, is "
        f"{kind.over_run}. {_STEPS} The interquartile mean (IQM) is the mean without the "
        f"lowest and highest quarter of seeds. {_INTERVAL}"
        f"{published_note if kind is TRAINING else ''}{_divergence(view.cells)}",
        _table(rows),
        folded=not view.leads,
    )


def _table(rows: Sequence[Mapping[str, object]]) -> pd.DataFrame:
    """Returns rows as a table without the columns that have no values."""
    return pd.DataFrame(rows).dropna(axis="columns", how="all")


def _unranked(cells: Sequence[Cell]) -> str:
    """Returns a sentence on imported curves beside runs, which are not ranked with them."""
    ranked = len(verified(cells))
    return " Imported rows are not ranked." if 0 < ranked < len(cells) else ""


def _divergence(cells: Sequence[Cell]) -> str:
    """Returns a sentence on how diverged seeds count, if there are any."""
    if not any(cell.diverged_count for cell in cells):
        return ""
    return " From its divergence on, a seed that diverged counts with return 0, the minimum."


def _diverged(cell: Cell) -> Value | None:
    count, seeds = cell.diverged_count, len(cell.seeds)
    if not count:
        return None
    return Value(f"{count} of {seeds}", count / seeds, numbers={"": count, "of": seeds})


def _published(cell: Cell, published: Sequence[PublishedCurve]) -> Value | None:
    found = published_beside(cell, published)
    if found is None:
        return None
    median, figure = found
    return Value(f"{median:.0f} ({name_of_figure(figure)})", median)


def spreads(view: View) -> TableItem | None:
    """Returns the table of spreads between seeds; None if no cell has two seeds."""
    found = [one for one in view.statistics if one.get("final_return", "standard_deviation")]
    if not found:
        return None
    rows = []
    for named, summary in zip(values.names([s.cell for s in found]), found, strict=True):
        one = summary.get("final_return", "standard_deviation")
        row: dict[str, object] = {**named, "n": one.seeds if one else 0}
        row["control steps"] = values.trained(summary.cell)
        for name in SPREADS:
            row[_SPREAD_NAMES[name]] = of_statistic(summary, "final_return", name)
        row[_BY_EPISODES] = of_statistic(summary, "final_return", BY_EPISODES)
        for name in SPREADS:
            row[f"{_SPREAD_NAMES[name]}, relative to {FULL}"] = of_statistic(
                summary, "final_return", f"{name}_ratio", formatting.ratio
            )
        rows.append(row)
    return TableItem(
        view.file("spread"),
        f"Spread of the final {view.kind.name} return between seeds",
        f"Spread of the final {view.kind.plural} of seeds: the width of the band from the 10th to "
        "the 90th percentile, of that from the 25th to the 75th, and the standard deviation; the "
        "standard deviation that episodes alone would cause if all agents had the same expected "
        "return; then the ratio of each spread to that of the same algorithm on the full "
        f"observation, {_AT_COMMON_STEP} ({view.kind.up_to}). {_INTERVAL}",
        _table(rows),
        folded=True,
    )


def learning_speed(view: View) -> TableItem | None:
    """Returns the table of control steps to a return; None if no cell has any."""
    timed = [summary for summary in view.statistics if summary.get("steps_to_solved", "median")]
    if not timed:
        return None
    rows = []
    for named, summary in zip(values.names([s.cell for s in timed]), timed, strict=True):
        half = summary.get("steps_to_half_best", "median")
        rows.append(
            {
                **named,
                "trained for": values.trained(summary.cell),
                **_steps_to(str(SOLVED), summary, "steps_to_solved"),
                _HALF: half and round(half.threshold or 0),
                **_steps_to(_HALF, summary, "steps_to_half_best"),
            }
        )
    what = (
        "the moving average of a seed's training returns first reaches a value (center of the "
        "first whole window)"
        if view.kind.smoothed
        else "an evaluation of a seed first reaches a value"
    )
    return TableItem(
        view.file("learning_speed"),
        f"Control steps to a value of the {view.kind.name} return",
        f"Control steps over all environments until {what}. Seeds that never reach it count as "
        f'later than all others; "{formatting.NOT_REACHED}" means that the number or an end of its '
        "interval is one of these. An unfinished run may still reach it. "
        f"{_INTERVAL}{_divergence(view.cells)}",
        _table(rows),
        folded=not view.leads,
    )


def _steps_to(goal: str, summary: Summary, measure: str) -> dict[str, Value | None]:
    """Returns the columns on the control steps to a return."""
    form = formatting.steps
    return {
        f"seeds that reach {goal}": values.reached(summary.get(measure, "median")),
        f"control steps to {goal}: median": of_statistic(summary, measure, "median", form),
        f"control steps to {goal}: IQM": of_statistic(summary, measure, "interquartile_mean", form),
    }


def comparisons(view: View) -> TableItem | None:
    """Returns the table of comparisons; None if there are none."""
    if not view.comparisons:
        return None
    difference = f"difference of IQMs of the final {view.kind.name} return"
    rows = [
        {
            "task": one.ours.task,
            "this": values.algorithm_name(one.ours),
            "against": values.algorithm_name(one.theirs),
            "n": values.counts(one.seeds, "other"),
            "at control step": values.at_step(one.control_steps),
            "probability of improvement": values.estimate(one.improvement, formatting.ratio),
            difference: values.estimate(one.difference, formatting.signed),
            "control steps not compared": values.at_step(one.cut) if one.cut else None,
        }
        for one in view.comparisons
    ]
    return TableItem(
        view.file("comparisons"),
        f"Comparisons of final {view.kind.plural}",
        'The probability that a run of "this" ends above one of the other (0.5: no difference), '
        f"and the difference of the interquartile means, for final {view.kind.plural} "
        f"{_AT_COMMON_STEP} ({view.kind.up_to}). {_INTERVAL} Intervals are not corrected for "
        "multiple comparisons: of 20 comparisons of equals, one is expected to look like a "
        "difference.",
        _table(rows),
        folded=True,
    )


def _number(value: float) -> Value:
    """Formats a number in the table of encoders; NaN is an empty text."""
    return Value("" if math.isnan(value) else f"{value:.4f}", float(value))


def encoder_errors(table: pd.DataFrame) -> TableItem:
    """Returns the table of the encoders' errors."""
    numbers = {
        "test": "not explained",
        "pca": "by PCA",
        "random": "by random projection",
        "heuristic": "heuristic's episodes: not explained",
        "pca_heuristic": "heuristic's episodes: by PCA",
        "yaw_rate": "R² of yaw rate",
        "forward_speed": "R² of forward speed",
        "tilt_rate": "R² of tilt rate",
        "reward": "R² of reward",
        "effective_rank": "effective rank",
    }
    shown = table[["task", "kind", "settings", "latents", "seeds", *numbers]]
    shown = shown.rename(columns={"seeds": "n", **numbers})
    for name in numbers.values():
        shown[name] = shown[name].map(_number)
    if not any(shown["settings"]):
        shown = shown.drop(columns="settings")
    return TableItem(
        "encoder_errors",
        "What encoders lose",
        "Unexplained fraction of the variance of the scaled features, on held-out episodes of the "
        "encoder's dataset and on episodes of the task's hand-written policy; for comparison, PCA "
        "and a random projection of the same size on the same states. The fractions of ddae and "
        "planar do not compare with others: ddae is scored on a later state, and planar does not "
        "decode position and heading. R² is of the next control step, predicted on held-out "
        "episodes by a small network from latents and action. Medians across the seeds of the "
        "encoders.",
        shown,
    )
