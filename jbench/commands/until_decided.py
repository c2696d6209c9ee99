"""`jbench sweep --until-decided`: analyses of comparisons while seeds are added."""

import itertools
from collections.abc import Callable, Container, Sequence
from typing import Any

from jbench.commands import output
from jbench.errors import RequestError
from jbench.numbers import signed, texts
from jbench.statistics.sequential import BLOCK
from jbench.statistics.verdicts import ERROR_RATE
from jbench.store import Results
from jbench.studies.comparisons import comparisons
from jbench.studies.entries import read_entries
from jbench.studies.matrix import Parts
from jbench.studies.quantities import QUANTITIES, SIMILAR
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.outcomes import Outcome, next_cells, outcomes
from jbench.training.status import failures_among, run_statuses
from jbench.wording import counted


def seeds_to_compare(matrix: str, max_seeds: int) -> list[int]:
    """Returns all seeds that a comparison of a matrix may need."""
    if max_seeds < BLOCK or max_seeds % BLOCK:
        raise RequestError(f"--max-seeds {max_seeds}: type a multiple of {BLOCK}.")
    planned = (entry.max_seeds for entry in read_entries(matrix).values())
    return list(range(max([max_seeds, *planned])))


def _sentence_on_errors(shares: Sequence[float]) -> str:
    """Returns the sentence on how probable a wrong decision is, given each comparison's share."""
    rates = dict.fromkeys(f"{share:.2%}" for share in (min(shares), max(shares)))
    between = " to ".join(rates)
    if len(shares) == 1:
        return f"The decision is wrong with a probability of at most {between}."

    return (
        f"Of all {len(shares)} decisions together one or more are wrong with a probability of at "
        f"most {ERROR_RATE:.0%}: {between} for each comparison, and more after others have found a "
        "difference."
    )


def add_seeds_until_decided(
    matrix: str,
    parts: Parts,
    cells: Sequence[Cell],
    typed: Sequence[str],
    results: Results,
    max_seeds: int,
    train: Callable[[Sequence[Cell]], object] | None,
) -> tuple[dict[str, Any], int]:
    """Adds seeds until comparisons are decided; if `train` is None, shows the runs needed next.

    `typed` are the comparisons that a user asks for, none for all; see `study.chosen`. Returns the
    JSON document, and the number of runs that the last analysis lacked.
    """
    chosen = comparisons(parts, read_entries(matrix), typed, max_seeds)
    shares = [comparison.share for comparison in chosen]
    most = max(comparison.max_seeds for comparison in chosen)
    errors = _sentence_on_errors(shares)
    output.say(f"Returns are compared after each {BLOCK} seeds, up to {most}. {errors}")
    tried = set[str]()
    while True:  # an interim analysis of all comparisons
        reached = outcomes(chosen, cells, results)
        needed_next = next_cells(reached, tried)
        _show_outcomes(reached, tried)
        if not needed_next or train is None:
            break
        tried |= {run.id for run in all_runs(needed_next)}
        train(needed_next)

    needed = [run.id for run in all_runs(needed_next)]
    if needed:
        configurations = counted(len(needed_next), "configuration")
        output.say(f"Needed next: {counted(len(needed), 'run')} in {configurations}.")

    needed_at_end = itertools.chain.from_iterable(outcome.needed for outcome in reached)
    statuses = run_statuses(needed_at_end, results)
    document = {"comparisons": [_described(outcome) for outcome in reached], "needed": needed}
    return {**document, "failures": failures_among(statuses)}, len(statuses)


def _show_outcomes(reached: Sequence[Outcome], tried: Container[str]) -> None:
    """Prints each comparison's decision; runs with the tried ids were trained, finished or not."""
    rows = []
    for outcome in reached:
        decision = outcome.decision
        verdict = _verdict(outcome)
        left = [run.id for run in outcome.needed if run.id in tried]
        if left:
            verdict += f": {left[0]} is not finished"
        elif outcome.unknown:
            verdict += f": {outcome.unknown} has no finite return"

        difference = ""
        interval = ""
        if decision.seeds:
            ends = (decision.low, decision.high)
            difference, interval = texts(signed, decision.difference, ends)

        name = outcome.comparison.name
        spent = f"{decision.spent:.2%}"
        rows.append((name, verdict, decision.seeds, difference, interval, spent))

    decided = sum(outcome.decision.verdict != "undecided" for outcome in reached)
    header = ("comparison", "verdict", "seeds", "difference", "interval", "error spent")
    output.table(f"Comparisons decided: {decided} of {len(rows)}", header, rows, ("error spent",))


def _verdict(outcome: Outcome) -> str:
    """Returns the decision in the words of the report."""
    word = QUANTITIES[outcome.comparison.claim].word(outcome.decision.verdict)
    if word == SIMILAR:
        return f"{word}, within {outcome.comparison.margin:g}"
    return word


def _described(outcome: Outcome) -> dict[str, Any]:
    """Returns an outcome for JSON."""
    comparison = outcome.comparison
    first = comparison.first
    second = comparison.second
    return {
        "comparison": comparison.name,
        **{name: getattr(first, name) for name in ("task", "algo", "representation")},
        "against": second.representation,
        "claim": comparison.claim,
        "share": comparison.share,
        **outcome.decision._asdict(),
        "needed": [run.id for run in outcome.needed],
    }
