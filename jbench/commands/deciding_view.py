"""Tables of the interim analyses of `jbench sweep --until-decided`."""

from collections.abc import Sequence
from typing import Any

from jbench.commands.output import Output
from jbench.report.analysis.claims import MARGIN
from jbench.statistics import sequential
from jbench.sweeps.comparisons import MatrixComparison
from jbench.sweeps.deciding import ComparisonOutcome, InterimAnalysis

_VERDICTS = {
    "larger": "higher",
    "smaller": "lower",
    "equal": f"similar, within {MARGIN:g}",
    "undecided": "undecided",
}


def introduction(chosen: Sequence[MatrixComparison], max_seeds: int) -> str:
    """Returns the sentence printed at first: the comparisons and the error rate."""
    rates = dict.fromkeys(
        f"{share:.2%}" for share in sorted(comparison.share for comparison in chosen)
    )
    return (
        f"Final returns are compared after each {sequential.BLOCK} seeds, up to {max_seeds}. Of "
        f"all {len(chosen)} decisions together one or more are wrong with a probability of at most "
        f"{sequential.ERROR_RATE:.0%}: {' to '.join([*rates][:: len(rates) - 1 or 1])} for each "
        "comparison, and more after others have found a difference."
    )


def show_analysis(analysis: InterimAnalysis, output: Output) -> None:
    """Prints each comparison's decision, its number of seeds, and the error rate spent."""
    outcomes = analysis.outcomes
    decided = sum(outcome.decision.verdict != "undecided" for outcome in outcomes)
    rows = []
    for outcome in outcomes:
        decision = outcome.decision
        verdict = _VERDICTS[decision.verdict]
        left = [run.id for run in outcome.needed if run.id in analysis.tried]
        if left:
            verdict += f": {left[0]} is not finished"
        known = decision.seeds > 0
        rows.append(
            [
                outcome.comparison.name,
                verdict,
                decision.seeds,
                f"{decision.difference:+.0f}" if known else "",
                f"[{decision.low:+.0f}, {decision.high:+.0f}]" if known else "",
                f"{decision.spent:.2%}",
            ]
        )
    header = ["comparison", "verdict", "seeds", "difference", "interval", "error spent"]
    output.table(f"Comparisons decided: {decided} of {len(outcomes)}", header, rows)


def described_outcomes(outcomes: Sequence[ComparisonOutcome]) -> list[dict[str, Any]]:
    """Returns the entries of comparisons in the JSON document."""
    return [
        {
            "comparison": outcome.comparison.name,
            "task": outcome.comparison.ours.task,
            "algo": outcome.comparison.ours.algo,
            "representation": outcome.comparison.ours.representation,
            "against": outcome.comparison.against,
            "claim": outcome.comparison.claim,
            "share": outcome.comparison.share,
            **outcome.decision._asdict(),
            "needed": [run.id for run in outcome.needed],
        }
        for outcome in outcomes
    ]
