"""The answer of a report in sentences: what reduction costs, and who solves what, by when."""

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
from jbench.wording import are, counted

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
    """Returns the answer according to one kind of return, in sentences."""
    answers = [one for one in map(_answer, view.statistics) if one is not None]
    with_full = [one for one in view.reductions if one.baseline == FULL]
    parts = [*_on_reductions(with_full), *_on_tasks(_without_encoded(answers))]
    if not parts:
        return "There are no returns yet."
    shown = [f"{part[0].upper()}{part[1:]}." for part in parts[:_MAX_PARTS]]
    left = len(parts) - _MAX_PARTS
    more = [f"{left} more {are(left)} below."] if left > 0 else []
    return " ".join(shown + more)


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
    who, tasks = _listed(names), _listed(list(dict.fromkeys(a.cell.task for a in group)))
    one, several = len(names) == 1, len(group) > 1
    medians = formatting.span([answer.median for answer in group], formatting.whole)
    reached = [answer.reached for answer in group if answer.reached != math.inf]
    when = (
        f"{SOLVED} after {formatting.span(reached, formatting.steps)} control steps"
        if reached
        else ""
    )
    if reached and len(reached) < len(group):
        when += f" in {len(reached)} of {len(group)} cells"
    count = formatting.span([float(answer.seeds) for answer in group], formatting.whole)
    seeds = f"{count} seed{'' if count == '1' else 's'}{' each' if several else ''}"
    parts = [f"median return{'s' * several} {medians}", when, seeds]
    details = f"({'; '.join(filter(None, parts))})"
    solves, do = ("solves", "does") if one else ("solve", "do")
    if verdict == "undecided":
        return f"whether {who} {solves} {tasks} is undecided {details}"
    return f"{who} {solves if verdict == 'supported' else f'{do} not solve'} {tasks} {details}"


def _on_reductions(found: Sequence[Reduction]) -> Iterator[str]:
    """Yields a sentence for each task, representation and outcome, with its algorithms."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for one in found:
        outcome, effects = _reduction_outcome(one)
        algo = f"{display_name(one.cell.algo)}{effects}"
        groups.setdefault((one.cell.task, one.cell.representation, outcome), []).append(algo)
    for (task, representation, outcome), algos in groups.items():
        numbers = numbers_seen(representation, task)
        what = f"{numbers} numbers ({representation}) instead of the full observation"
        yield outcome.format(task=task, what=what, who=_listed(algos))


def _reduction_outcome(one: Reduction) -> tuple[str, str]:
    """Returns the sentence for an outcome, with gaps to fill, and the effects that it rests on."""
    of_final, of_speed = (next(f for f in one.findings if f.claim == claim) for claim in "ac")
    final, gain = (values.estimate(f.effect, formatting.signed) for f in (of_final, of_speed))
    interval = ", 90% interval" if math.isfinite(of_final.effect.low) else ""
    seeds = f"{one.seeds[0]} and {one.seeds[1]} seeds"
    effects = f" ({final.text}{interval}; {seeds})" if final else ""
    outcome, speed = map(reduction_items.outcome, (of_final, of_speed))
    if outcome == "undecided" and final and gain and speed != "undecided":
        return (
            f"on {{task}}, with {{what}}, agents learn {speed}: {{who}}; whether their final "
            "returns are similar is undecided"
        ), f" ({gain.text} over the run, 95% interval; at the end {effects[2:]}"
    if outcome == "undecided":
        return "on {task}, whether {what} change the return of {who} is undecided", effects
    if outcome == "similar":
        return "on {task}, {what} leave the return of {who} similar", effects
    verb = "lower" if of_final.effect.value < 0 else "raise"
    return f"on {{task}}, {{what}} {verb} the return of {{who}}", effects


def _listed(names: Sequence[str]) -> str:
    """Returns names as a list in words."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
