"""The leaderboard: agents, hand-written policies and published curves, ranked on each task."""

from collections.abc import Collection, Hashable, Mapping

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.errors import RequestError
from jbench.names import HEURISTIC
from jbench.report.configurations import configuration_frame
from jbench.report.data import sources
from jbench.report.data.configuration import with_returns
from jbench.report.data.curves import PUBLISHED_KEY, SEQUENCE, read_published
from jbench.report.data.order import in_order
from jbench.report.data.source_names import IMPORTED, OWN, PUBLISHED, directory_source
from jbench.report.data.untrained import HAND_WRITTEN
from jbench.report.policies import hand_written_returns
from jbench.report.request import Request
from jbench.representation_names import FULL
from jbench.settings.algorithms import display_name
from jbench.statistics import bootstrap as st
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.store import Results
from jbench.store.tables import published_rows

COLUMNS = [
    "task",
    "rank",
    "entry",
    "algo",
    "representation",
    "median",
    "low",
    "high",
    "n",
    "steps_min",
    "steps",
]
_NAMES = {"source": "entry", "seeds": "n", "median_low": "low", "median_high": "high"}


def ranked_configurations(
    directories: Mapping[str, Results], request: Request
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the leaderboard of results directories, and sentences on unreadable records.

    Entries have the names of the directories, if there are several. The filters of the request
    apply, and its kind of return ranks. A RequestError if no directory has an entry.
    """
    parts = []
    by_hand = dict[str, FloatArray]()
    for name, results in directories.items():
        trained = OWN
        imported = IMPORTED
        if len(directories) > 1:
            trained = directory_source(name)
            imported = f"{trained}: {IMPORTED}"
        parts.append(sources.own(results, request, trained, strict=False))
        parts.append(sources.imported(results, request, imported))

    for part in parts:
        for task, returns in hand_written_returns(part.tables).items():
            if request.task in (None, task) and len(returns) > len(by_hand.get(task, ())):
                by_hand[task] = returns

    published = read_published(published_rows())
    published = published[published["figure"] != SEQUENCE]
    configurations = [config for part in parts for config in part.configurations]
    chosen = with_returns(configurations, request.returns)
    curves = [(config, config.curve(request.order, request.window)) for config in chosen]
    frame = leaderboard(configuration_frame(curves, published), by_hand, published, request.algo)
    problems = [problem for part in parts for problem in part.problems]
    if frame.empty:
        what = "hand-written policy" if HEURISTIC in request.algo else "run"
        raise RequestError(
            f"No {what} in {' and '.join(directories)} has {request.returns} returns to rank. "
            f"{' '.join(problems)}".strip()
        )

    return frame, problems


def leaderboard(
    ours: pd.DataFrame,
    by_hand: Mapping[str, FloatArray],
    published: pd.DataFrame,
    algos: Collection[str],
) -> pd.DataFrame:
    """Returns the entries by task and median of the final returns, best first.

    An entry shares the rank of the one above it, unless its 95% interval lies below that of the
    first entry of this rank; those without an interval or with fewer than `DECIDING_SEEDS` seeds
    have none.

    Args:
        ours: configurations of one kind of return.
        by_hand: returns of the episodes of hand-written policies, by task.
        published: the paper's learning curves.
        algos: select policies and published curves; all if there are none.

    Returns:
        `COLUMNS`, of which entry is the source of the runs, hand-written or published, and n the
        number of seeds; of a hand-written policy, of episodes.
    """
    if algos and HEURISTIC not in algos:
        by_hand = {}
    agents = _agents(ours)
    tasks = {*agents["task"], *by_hand}
    entries = [agents, _hand_written(by_hand), _published(published, tasks, algos)]
    every: pd.DataFrame = pd.concat(entries, ignore_index=True)
    every = every.reindex(columns=COLUMNS).sort_values("median", ascending=False, kind="stable")

    ranked = [_ranked(every[every["task"] == task]) for task in in_order(tasks)]
    frame = every
    if ranked:
        frame = pd.concat(ranked, ignore_index=True)

    return frame.astype(dict.fromkeys(("rank", "n", "steps_min", "steps"), "Int64"))


def _agents(ours: pd.DataFrame) -> pd.DataFrame:
    """Returns entries of configurations that have seeds."""
    agents = ours[ours["seeds"] > 0].rename(columns=_NAMES)
    words = agents["words"].where(agents["words"] == "", ", " + agents["words"])
    return agents.assign(representation=agents["representation"] + words)


def _hand_written(by_hand: Mapping[str, FloatArray]) -> pd.DataFrame:
    """Returns entries of hand-written policies, by the returns of their episodes on each task.

    A policy is one agent, whose return is the mean of its episodes: it stands for the median.
    """
    entries = []
    for task, returns in by_hand.items():
        mean = st.estimate(st.mean, [returns])
        entries.append(
            {
                "task": task,
                "entry": HAND_WRITTEN,
                "algo": HEURISTIC,
                "representation": FULL,
                "n": len(returns),
                "median": mean.value,
                "low": mean.low,
                "high": mean.high,
            }
        )
    return pd.DataFrame(entries)


def _published(
    published: pd.DataFrame, tasks: Collection[str], algos: Collection[str]
) -> pd.DataFrame:
    """Returns entries of published agents: of each its longest curve, or the best of several."""
    ends = published[published["task"].isin(tasks)].groupby(PUBLISHED_KEY).last()
    entries = ends.sort_values(["steps", "median"]).groupby(PUBLISHED_KEY[1:]).last().reset_index()
    steps = entries["steps"].round().astype(int)
    entries = entries.assign(entry=PUBLISHED, steps=steps, steps_min=steps)
    entries["algo"] = entries["algo"].map(display_name)
    return entries[entries["algo"].isin([*map(display_name, algos)])] if algos else entries


def _ranked(entries: pd.DataFrame) -> pd.DataFrame:
    """Returns entries, best first, with their ranks; see `leaderboard`."""
    decided = (entries["n"] >= DECIDING_SEEDS) & (entries["low"] <= entries["high"])
    ranks: dict[Hashable, int] = {}
    low = np.inf
    rank = 0
    for place, (index, entry) in enumerate(entries[decided].iterrows(), 1):
        if entry["high"] < low:
            low = entry["low"]
            rank = place
        ranks[index] = rank

    return entries.assign(rank=entries.index.map(ranks))
