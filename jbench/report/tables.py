"""The tables of a report: final returns, encoders, runs and the leaderboard; and all in order."""

import pandas as pd

from jbench.numbers import ratio, steps
from jbench.report.analysis.all_tasks import NORMALIZED
from jbench.report.comparison_tables import (
    claims_table,
    comparisons_table,
    decisions_table,
    verdicts_table,
)
from jbench.report.data.source_names import FILE, begins_with_source
from jbench.report.data.untrained import as_agents
from jbench.report.encoders import PREDICTED
from jbench.report.frames import Frames
from jbench.report.once import once
from jbench.report.table import (
    ALGO,
    INTERVAL,
    OBSERVED,
    RANGE,
    SEEDS,
    TASK,
    Column,
    FrameRow,
    Table,
    number,
    plain,
    with_ends,
)
from jbench.returns import TRAINING
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.task_specs import SOLVED_RETURN
from jbench.wording import in_prose

_FINAL = {
    "evaluation": "Mean return of a run's last evaluation, in which the policy is deterministic.",
    "training": "Mean return of a run's last 100 training episodes, exploration included, or of "
    "its last quarter if that is shorter.",
}
_DIVERGED = (
    "Diverged: seeds that count from then on as 0, or as their lowest return if that is negative."
)


@once
def tables(frames: Frames) -> list[Table]:
    """Returns the tables of a report that have rows, in the order of the page."""
    made = (
        make(frames)
        for make in (
            _final_returns,
            verdicts_table,
            decisions_table,
            comparisons_table,
            claims_table,
        )
    )
    ranked = leaderboard_table(frames.leaderboard, frames.returns)
    every = (*made, ranked, _encoders(frames), _runs(frames))
    return [table for table in every if len(table.frame)]


def _final(frames: Frames) -> str:
    """Returns the sentence that says what a final return is."""
    if frames.request.curves is None:
        return _FINAL[frames.returns]
    if frames.returns == TRAINING:
        return "Mean of the last 100 returns of a run, or of its last quarter if that is shorter."
    return "Last return of a run."


def _agent(frames: Frames) -> Column:
    """Returns the column of algorithms, which a file calls methods."""
    return _with_source("method" if frames.request.curves else "algorithm", "algo")


def _with_source(title: str, key: str) -> Column:
    """Returns a column of names that says where the runs of others come from."""

    def text(row: FrameRow) -> str:
        source = row["source"]
        name = row["configuration"] or f"{source}: "  # a run without an episode has no name
        return f"{source}: {row[key]}" if begins_with_source(name, source) else str(row[key])

    return Column(title, key, text)


_SPARE_COLUMNS = (
    "published median",
    "detectable",
    "draws",
    "s",
    "over the run",
    f"steps to {SOLVED_RETURN}",
    f"reach {SOLVED_RETURN}",
)
"""Columns of final returns that a narrow terminal leaves out, the first one first."""


def _averages(agents: pd.DataFrame) -> tuple[str, str]:
    """Returns the average that each row has, and the other one: of the median and the IQM.

    The methods of a file on all its tasks together have no median.
    """
    lacks_median = agents["median"].isna() & agents["iqm"].notna()
    return ("IQM", "median") if lacks_median.any() else ("median", "IQM")


@once
def _final_returns(frames: Frames) -> Table:
    """Returns the table of final returns: trained agents, then random and hand-written policies."""
    agents = frames.lead(frames.configurations)
    _, other = _averages(agents)
    title = (
        "Final returns by method" if frames.request.curves else f"Final {frames.returns} returns"
    )
    return Table(
        "final_returns",
        title,
        _final_returns_caption(frames, agents),
        _with_policies(agents, frames.baselines),
        _final_returns_columns(frames),
        spare=(*_SPARE_COLUMNS, other, "diverged", "steps"),
    )


def _final_returns_columns(frames: Frames) -> list[Column]:
    """Returns the columns of the table of final returns."""
    return [
        TASK,
        _agent(frames),
        OBSERVED,
        SEEDS,
        number("draws", "draws", _count, note="Draws: encoders that were trained for these seeds."),
        RANGE,
        number("diverged", "diverged", _count, note=_DIVERGED),
        with_ends("median", "median"),
        with_ends("IQM", "iqm", note="IQM: mean without the lowest and highest quarter of seeds."),
        with_ends(
            "over the run",
            "over_run",
            note="Over the run: IQM of the mean return from the first to the last control step at "
            "which all seeds have returns; it compares agents for which these are the same.",
        ),
        with_ends(
            "s", "s", note="s: standard deviation between agents, without that of the episodes."
        ),
        number(
            "detectable",
            "detectable",
            note="Detectable: smallest difference that these seeds would show.",
        ),
        Column(f"reach {SOLVED_RETURN}", "reached", "{0[reached]} of {0[seeds]}".format, True),
        with_ends(
            f"steps to {SOLVED_RETURN}",
            "solved_steps",
            steps,
            note="Later: after the end of the runs.",
        ),
        number("published median", "published"),
    ]


def _with_policies(agents: pd.DataFrame, policies: pd.DataFrame) -> pd.DataFrame:
    """Returns rows of agents, and below those of each task the policies that were not trained."""
    counts = dict.fromkeys(("seeds", "draws", "diverged", "reached", "steps_min", "steps"), "Int64")
    groups = (agents, as_agents(policies))
    both = [rows.reindex(columns=agents.columns).astype(counts) for rows in groups]
    rows: pd.DataFrame = pd.concat(both, ignore_index=True)
    return rows.sort_values("task", key=lambda task: pd.factorize(task)[0], kind="stable")


def _final_returns_caption(frames: Frames, agents: pd.DataFrame) -> str:
    """Returns what a reader of the final returns must know of them."""
    sentences = [_final(frames), INTERVAL]
    if frames.source.shared:
        sentences.append(f"{frames.source.shared}.")
    if len(frames.baselines):
        fewest = int(frames.baselines["episodes"].min())
        sentences.append(f"Random and hand-written policies: means of at least {fewest} episodes.")
    if NORMALIZED in set(agents["task"]):
        other = ", or the bounds in the notes" if frames.request.normalize else ""
        sentences.append(f"Normalized: 0 is the lowest and 1 the highest return of a task{other}.")
    return " ".join(sentences)


def _count(value: int) -> str:
    """Returns a count as text; 0 is left out."""
    return str(value or "")


def for_paper(table: Table, frames: Frames) -> Table:
    """Returns a table as LaTeX has it: final returns with the columns that were asked for.

    Raises a RequestError if there is no such column.
    """
    asked = frames.request.table_columns
    if table.name != "final_returns" or asked == ("all",):
        return table
    average, _ = _averages(frames.lead(frames.configurations))
    return table.of(asked or ("task", _agent(frames).title, OBSERVED.title, "seeds", average))


@once
def notes(frames: Frames) -> list[str]:
    """Returns the notes of a report: those on its runs, and one on columns without any value."""
    return [*frames.notes, *_without_cells(frames)]


def _without_cells(frames: Frames) -> list[str]:
    """Returns a note on columns that were asked for, and that no row has a value of."""
    asked = frames.request.table_columns
    if asked in (None, ("all",)):
        return []

    table = for_paper(_final_returns(frames), frames)
    shown, _ = table.shown
    empty = [column.title for column in table.columns if column not in shown]
    if not empty:
        return []

    columns = "column" if len(empty) == 1 else "columns"
    return [
        f"tables/final_returns.tex is without the {columns} {in_prose(empty, 'and')}, of which no "
        "row has a value."
    ]


def leaderboard_table(frame: pd.DataFrame, returns: str) -> Table:
    """Returns the leaderboard by one kind of return."""
    columns = [
        TASK,
        number("rank", "rank", str),
        plain("entry"),
        ALGO,
        plain("representation"),
        number("median", "median", ends=("low", "high")),
        number("n", "n", str),
        RANGE,
    ]
    caption = (
        f"{_FINAL[returns]} Medians over seeds; of a hand-written policy, the mean of its "
        f"episodes. {INTERVAL} An entry shares the rank of the one above it, unless its interval "
        "lies below that of the first entry of this rank; those with fewer than "
        f"{DECIDING_SEEDS} seeds have none. Published medians are training returns at the end of "
        "the paper's curves. Entries may have been trained for different numbers of control steps."
    )
    title = f"Leaderboard by final {returns} return"
    return Table("leaderboard", title, caption, frame, columns, spare=("rank", "steps", "n"))


def _encoders(frames: Frames) -> Table:
    """Returns the table of what encoders lose and what their latents predict."""
    numbers = {
        "test": "not explained",
        "pca": "by PCA",
        "random": "by random projection",
        "heuristic": "hand-written policy's: not explained",
        "pca_heuristic": "hand-written policy's: by PCA",
        **{name: f"R² of {text}" for name, text in PREDICTED.items()},
    }
    columns = [
        TASK,
        plain("encoder", "representation"),
        plain("settings"),
        number("latents", "latents", str),
        SEEDS,
        *(number(title, key, ratio) for key, title in numbers.items()),
    ]
    caption = (
        "Unexplained fraction of the variance of the scaled features, on held-out episodes and on "
        "the hand-written policy's; the fractions of ddae and planar do not compare with others. "
        "R²: the next control step, predicted from latents and action."
    )
    return Table("encoders", "What encoders lose", caption, frames.encoders, columns)


def _runs(frames: Frames) -> Table:
    """Returns the table of single runs."""

    def status(row: FrameRow) -> str:
        known = "" if row["source"] == FILE else str(row["status"])
        return "diverged" if row["diverged"] else known

    columns = [
        TASK,
        _agent(frames),
        OBSERVED,
        number("seed", "seed", str),
        number("steps", "steps", steps),
        number("final return", "final"),
        Column("status", "status", status),
        number("day", "day", str),
        _with_source("run", "run"),
    ]
    return Table("runs", "Runs", _final(frames), frames.runs, columns)
