"""Tables of the claims: verdicts, and the underlying comparisons."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.document import TableItem, Value
from jbench.report.tables import values


def verdicts(findings: Sequence[Finding]) -> TableItem:
    """Returns the table of claims, with the verdicts for each source and kind of return."""
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
        "Number of comparisons that support, contradict or leave open each claim, by source of the "
        "runs and kind of return: training episodes (exploration included) or evaluations of the "
        "deterministic policy. The paper's returns are of training.",
        pd.DataFrame(rows),
    )


def findings_table(findings: Sequence[Finding]) -> TableItem | None:
    """Returns the table of all comparisons that test a claim; None if there are none."""
    if not findings:
        return None
    formats = {
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
            "effect": values.estimate(one.effect, formats.get(one.claim, formatting.signed)),
            "verdict": one.verdict,
            "seeds that would decide": _seeds_needed(one),
            "remark": one.remark,
        }
        for one in findings
    ]
    return TableItem(
        "claims",
        "Each comparison behind the verdicts",
        "The effect is a difference of returns for (a), (c), (d) and (e), a ratio of standard "
        "deviations for (b) and (f), and a median return for (g) and (h). In brackets its "
        "uncertainty (95% interval; 90% for (a), which corresponds to two one-sided tests at 5%). "
        'Seeds per cell that would decide an undecided comparison: "80% power" is a power '
        'calculation for the effect as currently estimated; "six-seed rule" means that this effect '
        f"would need fewer, but that fewer than {DECIDING_SEEDS} seeds decide nothing.",
        pd.DataFrame(rows),
    )


def _seeds_needed(one: Finding) -> Value | None:
    if one.seeds_needed is None:
        return None
    seeds, rule = one.seeds_needed
    return Value(f"{seeds:,} ({rule})", seeds)
