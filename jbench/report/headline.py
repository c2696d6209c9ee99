"""The answer of a report in a sentence: who solves what, by when, and what reduction costs."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jbench.names import FULL
from jbench.report import formatting
from jbench.report.analysis.claims import Verdict
from jbench.report.analysis.examine import decide
from jbench.report.analysis.reduction import Reduction, numbers_seen
from jbench.report.analysis.scores import Summary
from jbench.report.data.cells import SOLVED, Cell
from jbench.report.formatting import display_name
from jbench.report.tables import reduction_items, values
from jbench.report.views import View, cells_of
from jbench.wording import counted

_MAX_PARTS = 5


class _Answer(NamedTuple):
    """Whether a cell solves its task.

    Attributes:
        cell: the cell.
        verdict: whether the median final return is `SOLVED` or more.
        median: median final return.
        seeds: number of seeds with a final return.
        reached: median control steps to `SOLVED`; infinite if most seeds don't reach it.
    """

    cell: Cell
    verdict: Verdict
    median: float
    seeds: int
    reached: float


def headline(view: View) -> str:
    """Returns the answer according to one kind of return, as a sentence."""
    answers = [one for one in map(_answer, view.statistics) if one is not None]
    shown = _without_encoded(answers)
    with_full = [one for one in view.reductions if one.baseline == FULL]
    parts = [*_on_tasks(shown), *map(_on_reduction, with_full)]
    if not parts:
        return "There are no returns yet."
    more = f"; and {len(parts) - _MAX_PARTS} more below" if len(parts) > _MAX_PARTS else ""
    sentence = "; ".join(parts[:_MAX_PARTS]) + more
    return f"{sentence[0].upper()}{sentence[1:]}."


def inventory(views: Sequence[View]) -> list[tuple[str, str]]:
    """Returns four numbers on what was run, each with its name."""
    cells = cells_of(views)
    if not cells:
        return []
    steps = sum(int(cell.steps.sum()) for cell in cells)
    texts = [
        counted(sum(len(cell.seeds) for cell in cells), "run"),
        counted(len(cells), "setting"),
        counted(len({cell.task for cell in cells}), "task"),
        f"{formatting.steps(steps)} control steps",
    ]
    return [(number, noun) for number, _, noun in (text.partition(" ") for text in texts)]


def _answer(summary: Summary) -> _Answer | None:
    median = summary.get("final_return", "median")
    if median is None or math.isnan(median.estimate.value):
        return None
    reached = summary.get("steps_to_solved", "median")
    verdict = decide(median.estimate, median.seeds, SOLVED)[0]
    steps = math.inf if reached is None else reached.estimate.value
    return _Answer(summary.cell, verdict, median.estimate.value, median.seeds, steps)


def _without_encoded(answers: Sequence[_Answer]) -> list[_Answer]:
    """Returns the answers with the full observation, or all if there are none."""
    plain = [one for one in answers if not one.cell.robots]
    full = [one for one in plain if one.cell.representation == FULL]
    return full or plain or list(answers)


def _on_tasks(answers: Sequence[_Answer]) -> Iterator[str]:
    """Yields a clause for each verdict and the learners and tasks that it is on."""
    verdicts: tuple[Verdict, ...] = ("supported", "contradicted", "undecided")
    for verdict in verdicts:
        groups: dict[tuple[str, ...], list[_Answer]] = {}
        for task in dict.fromkeys(one.cell.task for one in answers):
            of_task = [one for one in answers if one.cell.task == task]
            chosen = [one for one in of_task if one.verdict == verdict]
            if chosen:
                groups.setdefault(tuple(_names(chosen, of_task)), []).extend(chosen)
        for names, group in groups.items():
            yield _clause(verdict, names, group)


def _names(chosen: Sequence[_Answer], of_task: Sequence[_Answer]) -> Iterator[str]:
    """Yields the names of learners: the algorithm's alone if all its variants are chosen."""
    for algo in dict.fromkeys(one.cell.algo for one in chosen):
        mine = [one for one in chosen if one.cell.algo == algo]
        if len(mine) == sum(one.cell.algo == algo for one in of_task):
            learners = {one.cell.learner for one in mine}
            yield learners.pop() if len(learners) == 1 else display_name(algo)
        else:
            yield from (one.cell.short_name for one in mine)


def _clause(verdict: Verdict, names: Sequence[str], group: Sequence[_Answer]) -> str:
    one = len(names) == 1
    who, tasks = _listed(names), _listed(list(dict.fromkeys(a.cell.task for a in group)))
    medians = formatting.span([answer.median for answer in group], formatting.whole)
    reached = [answer.reached for answer in group if answer.reached != math.inf]
    when = (
        f"{SOLVED} after {formatting.span(reached, formatting.steps)} control steps"
        if reached
        else ""
    )
    count = formatting.span([float(answer.seeds) for answer in group], formatting.whole)
    seeds = f"{count} seed{'' if count == '1' else 's'}{' each' if len(group) > 1 else ''}"
    if verdict == "undecided":
        return (
            f"{who} {'ends' if one else 'end'} {tasks} with a median return of {medians}"
            + (f" ({when})" if when else "")
            + f", which does not decide whether it is solved ({seeds})"
        )
    solves = "solves" if one else "solve"
    unsolved = "does not solve" if one else "do not solve"
    details = "; ".join(filter(None, [f"median return {medians}", when, seeds]))
    return f"{who} {solves if verdict == 'supported' else unsolved} {tasks} ({details})"


def _on_reduction(one: Reduction) -> str:
    findings = {finding.claim: finding for finding in one.findings}
    finding, of_speed = findings["a"], findings["c"]
    effect, gain = (values.estimate(f.effect, formatting.signed) for f in (finding, of_speed))
    interval = " with a 90% interval" if math.isfinite(finding.effect.low) else ""
    cell, seeds = one.cell, f"{one.seeds[0]} and {one.seeds[1]} seeds"
    numbers = numbers_seen(cell.representation, cell.task)
    reduced = f"{numbers} numbers ({cell.representation}) instead of the full observation"
    algo, task = display_name(cell.algo), cell.task
    text = f" ({effect.text}{interval}; {seeds})" if effect else ""
    outcome, speed = reduction_items.outcome(finding), reduction_items.outcome(of_speed)
    if outcome == "undecided" and gain and speed != "undecided":
        return (
            f"{reduced} make {algo} learn {task} {speed} ({gain.text} over the run with a 95% "
            f"interval), but whether they change its final return is undecided{text}"
        )
    if outcome == "undecided":
        return f"whether {reduced} change the return of {algo} on {task} is undecided{text}"
    if outcome == "similar":
        return f"{reduced} leave the return of {algo} on {task} similar{text}"
    verb = "lower" if finding.effect.value < 0 else "raise"
    return f"{reduced} {verb} the return of {algo} on {task}{text}"


def _listed(names: Sequence[str]) -> str:
    """Returns names as a list in words."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
