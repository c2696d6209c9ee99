"""What `jbench sweep --until-decided` does and shows: looks, and the seeds between them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jbench.commands.output import Output
from jbench.errors import RequestError
from jbench.report.analysis import sequential
from jbench.report.analysis.claims import MARGIN
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.sweeps.deciding import (
    Comparison,
    Numbers,
    Outcome,
    next_cells,
    outcomes,
    rate_of_each,
)
from jbench.sweeps.matrix import Cell, all_runs

_VERDICTS = {
    "larger": "higher",
    "smaller": "lower",
    "equal": f"equal within {MARGIN:g}",
    "undecided": "undecided",
}


def decide_with_view(
    asked: Sequence[Comparison],
    results: Results,
    most: int,
    train: Callable[[Sequence[Cell]], object] | None,
    output: Output,
) -> tuple[list[Outcome], list[Cell]]:
    """Adds seeds in blocks until all comparisons are decided or have all seeds; shows each look.

    Args:
        asked: comparisons of a matrix.
        results: that hold the runs.
        most: seeds of a cell.
        train: trains the runs of some cells; None to look only.
        output: to print to.

    Returns:
        The outcome of each comparison, and the cells that are needed next: none if `train` is
        given and no run failed.

    Raises:
        RequestError: if the number of seeds is not a multiple of a block.
    """
    if most < sequential.BLOCK or most % sequential.BLOCK:
        raise RequestError(f"--max-seeds {most}: type a multiple of {sequential.BLOCK}.")
    output.say(
        f"Final returns are compared after each {sequential.BLOCK} seeds, up to {most}. Of all "
        f"{len(asked)} decisions together one or more are wrong with a probability of at most "
        f"{sequential.ERROR_RATE:.0%}: {rate_of_each(asked):.2%} for each comparison."
    )
    numbers, tried = Numbers(results), dict[str, RunSettings]()
    while True:
        found = outcomes(asked, numbers, results, most)
        _show(found, tried, output)
        wanted = next_cells(found, tried)
        if not wanted or train is None:
            return found, wanted
        tried |= {run.id: run for run in all_runs(wanted)}
        train(wanted)


def _show(found: Sequence[Outcome], tried: dict[str, RunSettings], output: Output) -> None:
    """Prints what is decided, at which look, and the error rate spent."""
    decided = sum(one.decision.verdict != "undecided" for one in found)
    rows = []
    for one in found:
        decision = one.decision
        verdict = _VERDICTS[decision.verdict]
        left = [run.id for run in one.needed if run.id in tried]
        if left:
            verdict += f": {left[0]} is not finished"
        known = decision.seeds > 0
        rows.append(
            [
                one.comparison.name,
                verdict,
                decision.seeds,
                f"{decision.difference:+.0f}" if known else "",
                f"[{decision.low:+.0f}, {decision.high:+.0f}]" if known else "",
                f"{decision.spent:.2%}",
            ]
        )
    header = ["comparison", "final return is", "seeds", "difference", "interval", "error spent"]
    output.table(f"{decided} of {len(found)} comparisons are decided", header, rows)


def described_outcomes(found: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Returns what the JSON document says of comparisons; numbers that are not finite are null."""
    return [
        {
            "comparison": one.comparison.name,
            "task": one.comparison.ours.task,
            "algo": one.comparison.ours.algo,
            "representation": one.comparison.ours.representation,
            "against": one.comparison.against,
            **{
                key: value if isinstance(value, str) or np.isfinite(value) else None
                for key, value in one.decision._asdict().items()
            },
            "needed": [run.id for run in one.needed],
        }
        for one in found
    ]
