"""Tables of what was compared: verdicts, planned decisions, two sides or methods, and claims."""

from jbench.numbers import ratio, signed, steps
from jbench.report.analysis.claim_frame import paper_claims
from jbench.report.analysis.findings import SIMILAR_RETURN, VERDICTS_ON_CLAIMS
from jbench.report.frames import Frames
from jbench.report.sides import named_sides
from jbench.report.table import (
    ALGO,
    INTERVAL,
    OBSERVED,
    SEEDS,
    TASK,
    Column,
    FrameRow,
    Table,
    number,
    plain,
    with_ends,
)
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.studies.quantities import QUANTITIES
from jbench.wording import in_prose

_OF = Column("of", "claim", lambda row: QUANTITIES[row["claim"]].title)
"""What a verdict is on."""


def verdicts_table(frames: Frames) -> Table:
    """Returns the table of verdicts: each reduced representation against its baselines."""
    rows = frames.lead(frames.verdicts)
    columns = [
        TASK,
        ALGO,
        OBSERVED,
        plain("against"),
        _OF,
        Column("verdict", "verdict", "{0[mark]} {0[text]}".format),
        number("difference", "value", signed, ("low", "high")),
        SEEDS,
        plain("corrected by", "corrected_by"),
    ]
    caption = (
        f"{frames.returns.capitalize()} returns at the last control step that every seed has "
        "reached. A verdict rests on an interval that is corrected for the other comparisons; the "
        f"95% interval of the difference alone is beside it. {_similar(frames)}Fewer than "
        f"{DECIDING_SEEDS} seeds decide nothing."
    )
    spare = ("corrected by", "difference")
    return Table("verdicts", "Does reduction help?", caption, rows, columns, spare)


def _similar(frames: Frames) -> str:
    """Returns a sentence on which final returns are similar, with a space after it; "" if none."""
    margins = {task: margin for task, margin in frames.margins.items() if margin}
    sizes = {*margins.values()}
    if not sizes:
        return ""
    if len(sizes) == 1:
        return f"Similar: within {sizes.pop():,g}. "

    each = [f"{margin:,g} on {task}" for task, margin in margins.items()]
    return f"Similar: within {in_prose(each, 'and')}. "


def decisions_table(frames: Frames) -> Table:
    """Returns the table of what the sequential test decides on the comparisons of studies."""

    def against(row: FrameRow) -> str:
        return ", ".join(filter(None, (row["against"], row["against_words"])))

    columns = [
        plain("study"),
        TASK,
        ALGO,
        OBSERVED,
        Column("against", "against", against),
        _OF,
        plain("verdict"),
        SEEDS,
        number("difference", "difference", signed, ("low", "high")),
        number("error spent", "spent", "{:.2%}".format),
    ]
    caption = (
        "Difference of the means of the first 5, 10, 15, … seeds, with its repeated confidence "
        "interval: of final returns, or for speed of mean returns over the run. Returns are those "
        "of evaluations, or of training where no run was evaluated. The family-wise error rate of "
        "all planned comparisons of a study is at most 5%."
    )
    return Table("sequential_test", "Sequential test", caption, frames.decisions, columns)


def comparisons_table(frames: Frames) -> Table:
    """Returns the table of the comparisons that were asked for, of two sides or of methods."""
    title = "Comparison of methods"
    names = [plain("this", "a"), plain("against", "b")]
    if frames.request.compare is not None:
        title = f"Comparison: {named_sides(frames.request.compare).together}"
        names = [plain("against"), plain("returns")]

    columns = [
        TASK,
        ALGO,
        OBSERVED,
        *names,
        Column("seeds", "seeds_a", "{0[seeds_a]}, {0[seeds_b]}".format, True),
        number("steps", "steps", steps),
        with_ends("probability", "p", ratio),
        number("difference", "difference", signed, ("low", "high")),
        plain("verdict", "text"),
    ]
    caption = (
        "Final returns at the last control step that every seed of both sides has reached: "
        "probability that a run of the first has a higher one than a run of the second, and "
        f"difference of the interquartile means. {INTERVAL} The verdict is corrected for the "
        f"number of rows. {_similar(frames)}".rstrip()
    )
    spare = ("probability", "steps", "difference")
    return Table("comparisons", title, caption, frames.comparisons, columns, spare)


def claims_table(frames: Frames) -> Table:
    """Returns the table of the tests of the paper's claims."""
    needed = "{0[seeds_needed]:,} ({0[seeds_needed_by]})".format
    columns = [
        Column("claim", "claim", "({0[claim]})".format),
        plain("runs", "source"),
        plain("returns"),
        plain("compared"),
        SEEDS,
        plain("verdict", "text"),
        number("by episodes alone", "by_episodes", ratio),
        Column("seeds that would decide", "seeds_needed", needed, True),
        plain("remark"),
    ]
    claims = paper_claims().itertuples()
    tests = " ".join(f"({letter}) {text} {test}" for letter, text, test in claims)
    caption = f"{tests} In brackets: 95% interval, 90% for ({SIMILAR_RETURN})."
    spare = ("remark", "by episodes alone", "seeds that would decide")
    return Table("claims", "The paper's claims", caption, frames.claims, columns, spare)


def claim_counts_table(frames: Frames) -> Table:
    """Returns how many comparisons support each claim of the paper, by runs and kind of return."""
    found = frames.claims.assign(count=1)
    keys = ["claim", "statement", "source", "returns"]
    counts = found.pivot_table(
        index=keys, columns="verdict", values="count", aggfunc="sum", fill_value=0, sort=False
    )
    counts = counts.reindex(columns=VERDICTS_ON_CLAIMS, fill_value=0).reset_index()
    columns = [
        Column("claim", "claim", "({0[claim]}) {0[statement]}".format),
        plain("runs", "source"),
        plain("returns"),
    ]
    columns += [number(verdict, verdict, str) for verdict in VERDICTS_ON_CLAIMS]
    caption = (
        "Number of comparisons with each verdict; undecided is not a verdict of no difference."
    )
    return Table(
        "claim_counts", "The paper's claims: number of comparisons", caption, counts, columns
    )
