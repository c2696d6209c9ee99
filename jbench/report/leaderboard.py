"""The leaderboard: agents, hand-written policies and published curves, ranked on each task."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from jbench.errors import RequestError
from jbench.names import FULL, HEURISTIC, TASKS
from jbench.report import sources
from jbench.report.analysis import heuristics, scores
from jbench.report.analysis import statistics as st
from jbench.report.analysis.scores import Summary
from jbench.report.data.cells import IMPORTED, OURS, LearnedCurve, in_order, of_kind
from jbench.report.data.curves import FloatArray
from jbench.report.data.published import PUBLISHED, PublishedCurve, read_published
from jbench.report.data.returns import KINDS, TRAINING, Returns
from jbench.report.document import TableItem
from jbench.report.formatting import display_name
from jbench.report.request import Request
from jbench.report.sources import Source
from jbench.report.tables import values
from jbench.report.views import curve_of
from jbench.store import Results, query

HAND_WRITTEN = "hand-written"


@dataclass(frozen=True)
class Entry:
    """An entry of the leaderboard.

    Attributes:
        source: `OURS` or the name of a results directory, `IMPORTED` or `NAME: IMPORTED`,
            `HAND_WRITTEN` or `PUBLISHED`.
        algo: algorithm, or `heuristic` for the hand-written policy.
        observation: representation, and the name of the variant in legends.
        median: of the final returns of its seeds, with the 95% interval.
        count: number of seeds; of a hand-written policy, of episodes; 0 for published curves,
            of which no single seeds are published.
        trained: minimum and maximum control steps of its seeds.
        rank: entries whose intervals cross share it; None if the entry is not ranked.
    """

    source: str
    task: str
    algo: str
    observation: str
    median: st.Estimate
    count: int
    trained: tuple[int, int] = (0, 0)
    rank: int | None = None

    @property
    def rankable(self) -> bool:
        """Whether its interval is known and not too narrow; see `statistics.DECIDING_SEEDS`."""
        return self.count >= st.DECIDING_SEEDS and self.median.low <= self.median.high


def of_results(databases: Mapping[str, Results], request: Request) -> tuple[list[Entry], list[str]]:
    """Returns the entries of results directories, and sentences on unreadable records.

    Args:
        databases: results directories by the name that their entries have; that of a single
            directory is not used.
        request: its filters apply; its kind of return ranks.

    Raises:
        RequestError: if no directory has an entry.
    """
    alone, found = len(databases) == 1, []
    for name, results in databases.items():
        ours, theirs = (OURS, IMPORTED) if alone else (name, f"{name}: {IMPORTED}")
        found.append(sources.own(results, request, ours, strict=False))
        found.append(sources.imported(results, request, theirs))
    kind = KINDS[request.returns]
    cells = [cell for source in found for cell in of_kind(source.cells, kind)]
    learned = [LearnedCurve(cell, curve_of(cell, request)) for cell in cells]
    published = read_published(query.published())
    ranked = entries(
        scores.summaries(learned, published), by_hand(found, request.task), published, request.algo
    )
    problems = [problem for source in found for problem in source.problems]
    if not ranked:
        where = " and ".join(databases)
        reasons = " ".join(problems)
        what = "hand-written policy" if request.algo == HEURISTIC else "run"
        raise RequestError(
            f"No {what} in {where} has {kind.name} returns to rank. {reasons}".strip()
        )
    return ranked, problems


def by_hand(found: Sequence[Source], task: str | None) -> dict[str, FloatArray]:
    """Returns the returns (episodes,) of the hand-written policy of each task; the longest."""
    returns: dict[str, FloatArray] = {}
    for source in found:
        for name, episodes in heuristics.returns_by_task(source.tables).items():
            if task in (None, name) and len(episodes) > len(returns.get(name, ())):
                returns[name] = episodes
    return returns


def entries(
    summaries: Sequence[Summary],
    by_hand: Mapping[str, FloatArray],
    published: Sequence[PublishedCurve],
    algo: str | None = None,
) -> list[Entry]:
    """Returns the entries by task and median, best first.

    Args:
        summaries: statistics of the agents, of one kind of return.
        by_hand: (episodes,) returns of the hand-written policy of each task.
        algo: only hand-written policies and published curves of this algorithm; None for all.
    """
    agents = [entry for entry in map(_of_cell, summaries) if entry is not None]
    policies = [
        Entry(HAND_WRITTEN, task, HEURISTIC, FULL, st.estimate(st.median, [returns]), len(returns))
        for task, returns in by_hand.items()
        if algo in (None, HEURISTIC)
    ]
    tasks = {entry.task for entry in (*agents, *policies)}
    curves = [one for one in published if one.task in tasks and algo in (None, one.algo)]
    every = [*agents, *policies, *_of_paper(curves)]
    ranked = []
    for task in in_order(tasks, TASKS):
        found = [entry for entry in every if entry.task == task]
        ranked += _ranked(sorted(found, key=lambda entry: -entry.median.value))
    return ranked


def table(ranked: Sequence[Entry], kind: Returns) -> TableItem:
    """Returns the leaderboard as a table."""
    column = f"final {kind.name} return: median"
    names = {OURS: "runs", PUBLISHED: f"{PUBLISHED} ({TRAINING.name} returns)"}
    rows = [
        {
            "task": entry.task,
            "rank": entry.rank,
            "entry": names.get(entry.source, entry.source),
            "algorithm": display_name(entry.algo),
            "observation": entry.observation,
            column: values.estimate(entry.median),
            "n": entry.count or None,
            "control steps": values.steps_between(*entry.trained) if entry.trained[1] else None,
        }
        for entry in ranked
    ]
    frame = pd.DataFrame(rows).astype({"rank": "Int64", "n": "Int64"})
    return TableItem(
        "leaderboard",
        f"Leaderboard by final {kind.name} return",
        f"{kind.final} Medians across seeds with their 95% intervals. Entries whose intervals "
        "cross that of the first entry of a rank share this rank. Entries without an interval or "
        f"with fewer than {st.DECIDING_SEEDS} seeds are not ranked. {HAND_WRITTEN.capitalize()} "
        f"policies have n episodes in place of seeds. {PUBLISHED.capitalize()} medians are "
        "training returns at the end of the paper's curves. Entries may have been trained for "
        "different numbers of control steps.",
        frame,
    )


def documents(ranked: Sequence[Entry]) -> list[dict[str, object]]:
    """Returns the entries as JSON values; unknown numbers are None."""
    return [
        {
            "task": entry.task,
            "rank": entry.rank,
            "source": entry.source,
            "algo": entry.algo,
            "observation": entry.observation,
            "median": entry.median.value,
            "low": _known(entry.median.low),
            "high": _known(entry.median.high),
            "n": entry.count or None,
            "steps_min": entry.trained[0],
            "steps_max": entry.trained[1],
        }
        for entry in ranked
    ]


def _ranked(entries: Iterable[Entry]) -> list[Entry]:
    """Ranks entries in the order of their medians."""
    ranked: list[Entry] = []
    first, above = None, 0
    for entry in entries:
        if not entry.rankable:
            ranked.append(entry)
            continue
        above += 1
        if first is None or entry.median.high < first.median.low:
            first = replace(entry, rank=above)
        ranked.append(replace(entry, rank=first.rank))
    return ranked


def _of_cell(summary: Summary) -> Entry | None:
    cell, median = summary.cell, summary.get("final_return", "median")
    if median is None or not median.seeds:
        return None
    names = cell.source, cell.task, cell.algo, cell.representation_words
    return Entry(*names, median.estimate, median.seeds, cell.trained)


def _of_paper(curves: Sequence[PublishedCurve]) -> list[Entry]:
    """Returns an entry for each published algorithm and representation on the plain robot.

    Of several curves, the longest counts, or the best of several such.
    """
    best: dict[tuple[str, str, str], tuple[float, float]] = {}
    for curve in curves:
        if not curve.sequence:
            key = curve.task, curve.algo, curve.representation
            end = float(curve.control_steps[-1]), float(curve.quantiles[50][-1])
            best[key] = max(best.get(key, end), end)
    return [
        Entry(PUBLISHED, *key, st.Estimate(median), 0, (round(end), round(end)))
        for key, (end, median) in best.items()
    ]


def _known(value: float) -> float | None:
    return value if value == value else None
