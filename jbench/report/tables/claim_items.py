"""Tables of the claims: verdicts, and the underlying comparisons."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, Finding, Verdict
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.published import PUBLISHED
from jbench.report.document import TableItem, Value
from jbench.report.tables import values

_MARKS: dict[Verdict, str] = {
    "supported": "\N{CHECK MARK}",
    "contradicted": "\N{BALLOT X}",
    "undecided": "?",
}
"""A mark for each verdict, which is always beside the word."""


def _verdict(group: Sequence[Finding]) -> Value | None:
    """Returns verdicts as a mark and words: `? undecided`, with numbers if they differ."""
    counts = Counter(one.verdict for one in group)
    given = {name: counts[name] for name in _MARKS if counts[name]}
    if not given:
        return None
    texts = [
        f"{_MARKS[name]} {name}" + (f" ({count} of {counts.total()})" if len(given) > 1 else "")
        for name, count in given.items()
    ]
    order = min(list(_MARKS).index(name) for name in given)
    return Value(", ".join(texts), str(order), numbers={name: counts[name] for name in _MARKS})


def verdicts(findings: Sequence[Finding]) -> TableItem:
    """Returns the table of claims, with a column of verdicts for each source and kind of return.

    The figures of the paper share a column.
    """
    groups: dict[tuple[str, str], list[Finding]] = {}
    for one in findings:
        source = PUBLISHED if one.source.startswith("Figure") else one.source
        groups.setdefault((source, one.returns), []).append(one)
    columns = sorted(groups, key=lambda name: (name[0] == PUBLISHED, *name))
    rows = [
        {
            "claim": f"({letter}) {claim.text}",
            **{
                f"{source}, {returns}": _verdict(
                    [one for one in groups[source, returns] if one.claim == letter]
                )
                for source, returns in columns
            },
        }
        for letter, claim in CLAIMS.items()
    ]
    return TableItem(
        "verdicts",
        "Verdicts on the paper's claims",
        "Verdicts by source of the runs and kind of return: training episodes (exploration "
        "included) or evaluations of the deterministic policy. The paper's returns are of "
        "training. Nothing is written where no comparison tests the claim. Where comparisons of a "
        "claim differ, their numbers are given.",
        pd.DataFrame(rows),
    )


def findings_table(findings: Sequence[Finding]) -> TableItem | None:
    """Returns the table of all comparisons that test a claim; None if there are none."""
    if not findings:
        return None
    formats = {
        "b": formatting.ratio,
        "f": formatting.ratio,
        "g": values.against_solved,
        "h": values.against_solved,
    }
    rows = [
        {
            "claim": f"({one.claim})",
            "runs": one.source,
            "returns": one.returns,
            "compared": one.compared,
            "n": one.seeds,
            "effect": values.estimate(one.effect, formats.get(one.claim, formatting.signed)),
            "by episodes alone": values.by_episodes(one),
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
        folded=True,
    )


def _seeds_needed(one: Finding) -> Value | None:
    if one.seeds_needed is None:
        return None
    seeds, rule = one.seeds_needed
    return Value(f"{seeds:,} ({rule})", seeds)
