"""The document of a report: what it says first, its sections, and where each run comes from."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jbench.report import figure_items, table_items, wording
from jbench.report.behaviour import Behaviour
from jbench.report.cells import Cell
from jbench.report.claims import CLAIMS, Finding
from jbench.report.comparisons import Comparison
from jbench.report.document import Document, Item, Section, TableItem
from jbench.report.drawing import SOLVED, LearnedCurve
from jbench.report.figures import display_name
from jbench.report.published import PublishedCurve
from jbench.report.request import Request
from jbench.report.scores import Summary
from jbench.report.statistics import DECIDING_SEEDS

_SEEDS = (
    "A seed is the only thing that is repeated: all episodes of a run are averaged first, and "
    "every number across seeds is of as many numbers as there are seeds, n. A percentile band is "
    "spread: where the seeds are. An interval is uncertainty: where the number itself could be."
)
_ORDERS = (
    "Quantile-first, the order of the paper's Figure 9, takes the quantiles across seeds in each "
    "episode and then averages them over a window of episodes, so its bands hold the ups and "
    "downs of single episodes too. Smooth-first, the order of Figure 8, averages each seed over "
    "the window and then takes the quantiles across seeds, so its bands show how seeds differ "
    "and are narrower."
)
_CLAIMS = (
    "Each claim is tested by comparisons that were fixed before any data were looked at. Of the "
    "published curves only medians and bands are known, so most of what the paper claims can't be "
    "decided from them: the remark says why."
)
_TESTS = [f"({letter}) {claim.text} {claim.test}" for letter, claim in CLAIMS.items()]


@dataclass(frozen=True)
class Material:
    """All that a report is made of.

    Attributes:
        request: what was asked for.
        learned: our curves, in the order of the paper.
        published: the paper's curves.
        aggregate: points of our curves, as `summaries.aggregate_curves` returns them.
        table: a row for each cell, as `summaries.summary_table` returns it.
        statistics: of each cell, in the same order.
        comparisons: of cells with each other.
        findings: on the claims; None if they were not asked for.
        encoders: errors of encoders, as `encoders.encoder_table` returns them.
        seen: states of policies.
        runs: rows of the table `runs`.
        notes: sentences for a reader.
        problems: sentences on what can't be read.
    """

    request: Request
    learned: Sequence[LearnedCurve]
    published: Sequence[PublishedCurve]
    aggregate: pd.DataFrame
    table: pd.DataFrame
    statistics: Sequence[Summary]
    comparisons: Sequence[Comparison]
    findings: Sequence[Finding] | None
    encoders: pd.DataFrame
    seen: Sequence[Behaviour]
    runs: pd.DataFrame
    notes: Sequence[str]
    problems: Sequence[str]


def document(made_of: Material) -> Document:
    """Returns the document of a report."""
    sections = (
        Section("Final returns", [_SEEDS], _returns(made_of)),
        Section("Learning curves", [_ORDERS], _curves(made_of)),
        Section("Comparisons", [], _present([table_items.comparisons(made_of.comparisons)])),
        Section("The paper's claims", [_CLAIMS, *_TESTS], _claims(made_of)),
        Section("Encoders", [], _encoders(made_of)),
        Section(
            "What policies do",
            [],
            list(figure_items.of_behaviour(made_of.seen, made_of.request)),
        ),
    )
    compared = made_of.request.compare
    return Document(
        title="Jitterbug: " + (" against ".join(compared) if compared else "what was learned"),
        summary=list(_summary(made_of)),
        problems=made_of.problems,
        notes=made_of.notes,
        sections=[section for section in sections if section.items],
        provenance=provenance(made_of.runs),
        command=made_of.request.command,
    )


def tables(of: Document) -> list[TableItem]:
    """Returns all tables of a document."""
    items = (item for section in of.sections for item in section.items)
    return [item for item in items if isinstance(item, TableItem)]


def provenance(runs: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each run: where it comes from.

    Columns: run, source (where there are several), status, begun (UTC), wall time (s), processor,
    cores, threads, jbench, python, the versions of packages, git revision, command.
    """
    rows = []
    for row in runs.to_dict("records"):
        recorded = json.loads(row["provenance"])
        recorded = recorded if isinstance(recorded, dict) else {}
        packages = recorded.get("packages")
        command = recorded.get("command")
        rows.append(
            {
                "run": row["run"],
                **({"source": row["source"]} if "source" in row else {}),
                "status": row["status"],
                "begun": row["created"],
                "wall time (s)": row["wall_time"],
                **{name: _text(recorded.get(name)) for name in ("processor", "cores", "threads")},
                **{name: _text(recorded.get(name)) for name in ("jbench", "python")},
                **(
                    {str(name): _text(version) for name, version in packages.items()}
                    if isinstance(packages, dict)
                    else {}
                ),
                "git revision": _text(recorded.get("git_revision")),
                "command": " ".join(map(str, command))
                if isinstance(command, list)
                else _text(command),
            }
        )
    return pd.DataFrame(rows)


def _text(value: Any) -> str:
    return "" if value is None else value if isinstance(value, str) else json.dumps(value)


def _returns(made_of: Material) -> list[Item]:
    if not made_of.learned:
        return []
    drawn = figure_items.of_returns(made_of.learned, made_of.table, made_of.request)
    return [
        table_items.final_returns(made_of.learned),
        *drawn,
        *_present(
            [
                table_items.returns_of_cells(made_of.statistics, made_of.table),
                table_items.spreads(made_of.statistics),
                table_items.learning_speed(made_of.statistics),
            ]
        ),
    ]


def _curves(made_of: Material) -> list[Item]:
    learned, request = made_of.learned, made_of.request
    curves = figure_items.of_curves(learned, made_of.published, made_of.aggregate, request)
    return [*curves, *figure_items.of_time(learned, made_of.runs, request)]


def _claims(made_of: Material) -> list[Item]:
    if made_of.findings is None:
        return []
    findings = made_of.findings
    return _present([table_items.verdicts(findings), table_items.findings_table(findings)])


def _encoders(made_of: Material) -> list[Item]:
    if made_of.encoders.empty:
        return []
    drawn = figure_items.of_encoders(made_of.encoders, made_of.request)
    return [*drawn, table_items.encoder_errors(made_of.encoders)]


def _present(items: Iterable[TableItem | None]) -> list[Item]:
    return [item for item in items if item is not None]


def _summary(made_of: Material) -> Iterator[str]:
    """Gives the sentences that come first."""
    if not made_of.learned:
        yield "There are no runs yet; this is what else was made."
        return
    yield _what_was_run(made_of)
    yield _what_is_solved(made_of)
    if made_of.request.compare:
        yield from _how_they_compare(made_of.comparisons)
    if made_of.findings is None:
        yield "For verdicts on the paper's claims, type the same command with --claims."
        return
    for letter, claim in CLAIMS.items():
        yield f"({letter}) {claim.text} {_verdict(letter, made_of.findings)}"


def _what_was_run(made_of: Material) -> str:
    cells = [item.cell for item in made_of.learned]
    runs = sum(len(cell.seeds) for cell in cells)
    statuses = Counter(made_of.runs["status"])
    going = [f"{statuses[name]} {name}" for name in ("unfinished", "failed") if statuses[name]]
    tasks = len({cell.task for cell in cells})
    return (
        f"{_counted(runs, 'run')} in {_counted(len(cells), 'cell')} on {_counted(tasks, 'task')}: "
        + "; ".join(f"{_named(cell)}, n = {len(cell.seeds)}" for cell in cells[:_MOST_NAMED])
        + (f"; and {len(cells) - _MOST_NAMED} more" if len(cells) > _MOST_NAMED else "")
        + (f". Of all runs, {' and '.join(going)}." if going else ".")
    )


_MOST_NAMED = 12


def _what_is_solved(made_of: Material) -> str:
    solved: list[str] = []
    above: list[str] = []
    for summary in made_of.statistics:
        one = summary.get("final_return", "median")
        if one is not None and one.estimate.value >= SOLVED:
            sure = one.estimate.low >= SOLVED and one.seeds >= DECIDING_SEEDS
            (solved if sure else above).append(_told(summary))
    said = f"Solved, with the whole 95% interval of the median at {SOLVED} or more, of at least "
    said += f"{DECIDING_SEEDS} seeds: "
    said += f"{'; '.join(solved) or 'nothing'}."
    if above:
        said += f" The median is there, but that is not sure: {'; '.join(above)}."
    return said


def _told(summary: Summary) -> str:
    one = summary.get("final_return", "median")
    value = wording.of_statistic(one)
    told = value.text if value else ""
    return f"{_named(summary.cell)} ({told}, n = {len(summary.cell.seeds)})"


def _named(cell: Cell) -> str:
    return f"{cell.prefix}{cell.task} {display_name(cell.algo)} {cell.seen}"


def _how_they_compare(found: Sequence[Comparison]) -> Iterator[str]:
    for one in found:
        improvement = wording.estimate(one.improvement, wording.ratio)
        gap = wording.estimate(one.difference, wording.signed)
        if improvement is not None and gap is not None:
            yield (
                f"{one.ours.task} {display_name(one.ours.algo)} {one.ours.seen}: a run of "
                f"{one.ours.source} ends above one of {one.theirs.source} with a probability of "
                f"{improvement.text}; the interquartile means differ by {gap.text} "
                f"(n = {one.seeds[0]}, {one.seeds[1]}; 95% intervals)."
            )


def _verdict(letter: str, findings: Sequence[Finding]) -> str:
    """Says how many comparisons support a claim, by whose runs."""
    ours = [f for f in findings if f.claim == letter]
    if not ours:
        return "No runs test it."
    said = []
    for source in dict.fromkeys(f.source for f in ours):
        counts = Counter(f.verdict for f in ours if f.source == source)
        told = ", ".join(f"{count} {name}" for name, count in counts.most_common())
        said.append(f"{source}: {told}")
    sentence = "; ".join(said)
    return f"{sentence[0].upper()}{sentence[1:]}."


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
