"""The tables of the claims: verdicts, and the comparisons behind them."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.document import TableItem, Value
from jbench.report.tables import values


def verdicts(findings: Sequence[Finding]) -> TableItem:
    """Returns the table of claims: how often each is supported, by whose runs and which returns."""
    rows = []
    for letter, claim in CLAIMS.items():
        tested = [f for f in findings if f.claim == letter]
        groups: list[tuple[str, str]] = [*dict.fromkeys((f.source, f.returns) for f in tested)]
        for source, returns in groups or [("none that test it", "")]:
            group = [f.verdict for f in tested if (f.source, f.returns) == (source, returns)]
            counts = Counter(group)
            rows.append(
                {
                    "claim": f"({letter}) {claim.text}",
                    "runs": source,
                    "returns": returns,
                    **{name: counts[name] for name in ("supported", "contradicted", "undecided")},
                }
            )
    return TableItem(
        "verdicts",
        "Verdicts on the paper's claims",
        "How many comparisons support, contradict or leave open each claim, of whose runs, and by "
        "which returns: those of training episodes, exploration included, or those of evaluations "
        "of the deterministic policy. The paper's are of training.",
        pd.DataFrame(rows),
    )


def findings_table(findings: Sequence[Finding]) -> TableItem | None:
    """Returns the table of each comparison that tests a claim; None where there is none."""
    if not findings:
        return None
    say = {
        "b": formatting.ratio,
        "f": formatting.ratio,
        "g": formatting.whole,
        "h": formatting.whole,
    }
    rows = [
        {
            "claim": f"({one.claim})",
            "runs": one.source,
            "returns": one.returns,
            "compared": one.compared,
            "n": one.seeds,
            "effect": values.estimate(one.effect, say.get(one.claim, formatting.signed)),
            "verdict": one.verdict,
            "seeds that would decide": _seeds_needed(one),
            "remark": one.remark,
        }
        for one in findings
    ]
    return TableItem(
        "claims",
        "Each comparison behind the verdicts",
        "The effect is what the claim speaks of: a difference of returns for (a), (c), (d) and "
        "(e), a ratio of standard deviations for (b) and (f), a median return for (g) and (h). In "
        "brackets its uncertainty (95% interval; 90% for (a), where two one-sided tests at 5% are "
        'meant). Seeds that would decide an undecided comparison, of each cell: "80% power" is a '
        'power calculation, for an effect that is what it seems to be now; "six-seed rule" says '
        f"that this effect would need fewer, but that fewer than {DECIDING_SEEDS} seeds decide "
        "nothing.",
        pd.DataFrame(rows),
    )


def _seeds_needed(one: Finding) -> Value | None:
    if one.seeds_needed is None:
        return None
    seeds, rule = one.seeds_needed
    return Value(f"{seeds:,} ({rule})", seeds)
