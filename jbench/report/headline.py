"""Headline of a report: the effects of reduction, and which agents solve which tasks, and when."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jbench.names import FULL, one_of
from jbench.report import formatting
from jbench.report.analysis.claims import Verdict
from jbench.report.analysis.examine import decide_solved
from jbench.report.analysis.reduction import Reduction
from jbench.report.analysis.scores import Summary
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.cells import SOLVED, Cell
from jbench.report.formatting import display_name
from jbench.report.tables import reduction_items, values
from jbench.report.views import View, cells_of
from jbench.wording import are, counted

_MAX_PARTS = 5
_SPEEDS = ("faster", "slower")
_REDUCTIONS = {
    "lower": "agents reach lower final returns with {names} than with the full observation",
    "higher": "agents reach higher final returns with {names} than with the full observation",
    "similar": "agents reach similar final returns with {names} and with the full observation",
    "undecided": "it is undecided whether agents reach similar final returns with {names} and with "
    "the full observation",
}
_REDUCTIONS |= {
    speed: f"agents learn {speed} with {{names}} than with the full observation; whether their "
    "final returns are similar is undecided"
    for speed in _SPEEDS
}


class _Answer(NamedTuple):
    """Whether a cell solves its task.

    Attributes:
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
    """Returns the headline according to one kind of return, in sentences."""
    answers = [one for one in map(_answer, view.statistics) if one is not None]
    with_full = [one for one in view.reductions if one.baseline == FULL]
    parts = [*_on_reductions(with_full), *_on_tasks(_shown(answers))]
    if not parts:
        return "There are no returns yet."
    shown = [f"{formatting.capitalized(part)}." for part in parts[:_MAX_PARTS]]
    left = len(parts) - _MAX_PARTS
    more = [f"{left} more {are(left)} below."] if left > 0 else []
    return " ".join([*shown, *more, f"(These are {view.kind.plural}.)"])


def inventory(views: Sequence[View]) -> list[tuple[str, str]]:
    """Returns four numbers on what was run, each with its name."""
    cells = cells_of(views)
    if not cells:
        return []
    # A seed that diverged has points, but no control steps, up to the end of the others.
    steps = sum(int(cell.steps[~cell.diverged].sum()) for cell in cells)
    texts = [
        counted(sum(len(cell.seeds) for cell in cells), "run"),
        counted(len(cells), "cell"),
        counted(len({cell.task for cell in cells}), "task"),
        f"{formatting.steps(steps)} control steps",
    ]
    return [(number, noun) for number, _, noun in (text.partition(" ") for text in texts)]


def _answer(summary: Summary) -> _Answer | None:
    median = summary.get("final_return", "median")
    if median is None or math.isnan(median.estimate.value):
        return None
    reached = summary.get("steps_to_solved", "median")
    verdict = decide_solved(median.estimate, median.seeds)[0]
    steps = math.inf if reached is None else reached.estimate.value
    return _Answer(summary.cell, verdict, median.estimate.value, median.seeds, steps)


def _shown(answers: Sequence[_Answer]) -> Sequence[_Answer]:
    """Returns the answers on the full observation, and of these the ones with enough seeds.

    A condition that no answer meets is left out.
    """
    plain = [one for one in answers if not one.cell.robots]
    full = [one for one in plain if one.cell.representation == FULL]
    shown = full or plain or answers
    return [one for one in shown if one.seeds >= DECIDING_SEEDS] or shown


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
    who = one_of(names, "and")
    tasks = one_of(dict.fromkeys(answer.cell.task for answer in group), "and")
    one, several = len(names) == 1, len(group) > 1
    medians = formatting.span([answer.median for answer in group], values.against_solved)
    reached = [answer.reached for answer in group if answer.reached != math.inf]
    when = ""
    if reached:
        when = f"return {SOLVED} after {formatting.span(reached, formatting.steps)} control steps"
    if 0 < len(reached) < len(group):
        when += f" in {len(reached)} of {len(group)} cells"
    seeds = _seeds([answer.seeds for answer in group]) + (" each" if several else "")
    parts = [f"median return{'s' if several else ''} {medians}", when, seeds]
    details = f"({'; '.join(filter(None, parts))})"
    solves, do = ("solves", "does") if one else ("solve", "do")
    if verdict == "undecided":
        return f"whether {who} {solves} {tasks} is undecided {details}"
    return f"{who} {solves if verdict == 'supported' else f'{do} not solve'} {tasks} {details}"


def _on_reductions(found: Sequence[Reduction]) -> Iterator[str]:
    """Yields a sentence for each source, task and outcome; the decided ones first."""
    groups: dict[tuple[str, str], list[Reduction]] = {}
    for one in found:
        where = f"{one.cell.prefix}on {one.cell.task}"
        groups.setdefault((where, _outcome(one)), []).append(one)
    for (where, outcome), group in sorted(groups.items(), key=lambda g: g[0][1] == "undecided"):
        claim = "c" if outcome in _SPEEDS else "a"
        effects: dict[str, list[str]] = {}
        for one in group:
            effect = reduction_items.effect_text(one.finding(claim))
            text = " ".join(filter(None, (display_name(one.cell.algo), one.cell.words, effect)))
            effects.setdefault(one.cell.representation, []).append(text)
        listed = [f"{name}: {', '.join(texts)}" for name, texts in effects.items()]
        sentence = _REDUCTIONS[outcome].format(names=one_of(effects))
        yield f"{where}, {sentence} ({'; '.join([*listed, *_basis(group, claim)])})"


def _outcome(one: Reduction) -> str:
    """Returns how agents end, or how fast they learn if only this is decided."""
    final, speed = (reduction_items.outcome(one.finding(claim)) for claim in "ac")
    return speed if final == "undecided" else final.partition(" ")[0]


def _basis(group: Sequence[Reduction], claim: str) -> Iterator[str]:
    """Yields the kind of the effects' intervals, if there are any, and the numbers of seeds."""
    intervals = sum(math.isfinite(one.finding(claim).effect.low) for one in group)
    if intervals:
        kind = "means over the run, 95%" if claim == "c" else "90%"
        yield f"{kind} interval{'s' if intervals > 1 else ''}"
    yield _seeds([number for one in group for number in one.seeds])


def _seeds(numbers: Sequence[int]) -> str:
    count = formatting.span(numbers, formatting.whole)
    return f"{count} seed{'' if count == '1' else 's'}"
