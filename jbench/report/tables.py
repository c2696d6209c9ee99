"""The tables of a report."""

import pandas as pd

from jbench.report.analysis.claims import paper_claims
from jbench.report.analysis.scores import NORMALIZED
from jbench.report.data.configuration import OWN
from jbench.report.data.returns import FILE, SOLVED, TRAINING, ratio, signed, steps
from jbench.report.encoders import PREDICTED
from jbench.report.frames import Frames
from jbench.report.table import Column, Row, Table, estimate, number, plain
from jbench.statistics.bootstrap import DECIDING_SEEDS
from jbench.studies.deciding import MARGIN

_INTERVAL = "In brackets: 95% interval."
_FINAL = {
    "evaluation": "Mean return of a run's last evaluation, in which the policy is deterministic.",
    "training": "Mean return of a run's last 100 training episodes, exploration included, or of "
    "its last quarter if that is shorter.",
}
COMPARED = {"a": "final return", "b": "variability", "c": "speed"}  # by a verdict's claim


def tables(frames: Frames) -> list[Table]:
    """Returns the tables of a report that have rows, in the order of the page."""
    made = (make(frames) for make in (_final_returns, _verdicts, _decisions, _comparisons, _claims))
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

    def text(row: Row) -> str:
        apart = row["source"] not in (OWN, FILE)
        return f"{row['source']}: {row[key]}" if apart else str(row[key])

    return Column(title, key, text)


def _range(row: Row) -> str:
    """Returns the control steps of the shortest and the longest run, once if they are equal."""
    return "\N{EN DASH}".join(dict.fromkeys((steps(row["steps_min"]), steps(row["steps"]))))


_TASK = plain("task")
_ALGO = plain("algorithm", "algo")
OBSERVED = Column(
    "representation",
    "representation",
    lambda row: ", ".join(filter(None, (row["representation"], row["words"]))),
)
_SEEDS = number("seeds", "seeds", str)
_RANGE = Column("steps", "steps", _range, numeric=True)


def _final_returns(frames: Frames) -> Table:
    """Returns the table of final returns: trained agents, then random and hand-written policies."""
    agents = frames.lead(frames.configurations)
    policies = frames.baselines.rename(columns={"low": "median_low", "high": "median_high"})
    names = policies["policy"].replace("random", "random actions")
    policies = policies.assign(source=OWN, representation="", words="", algo=names)
    counts = dict.fromkeys(("seeds", "draws", "diverged", "reached", "steps_min", "steps"), "Int64")
    both = [rows.reindex(columns=agents.columns).astype(counts) for rows in (agents, policies)]
    rows = pd.concat(both, ignore_index=True)
    rows = rows.sort_values("task", key=lambda task: pd.factorize(task)[0], kind="stable")

    columns = [
        _TASK,
        _agent(frames),
        OBSERVED,
        _SEEDS,
        number("draws", "draws", _count, note="Draws: encoders that were trained for these seeds."),
        _RANGE,
        number(
            "diverged", "diverged", _count, note="Diverged: seeds that count as 0 from then on."
        ),
        estimate("median", "median"),
        estimate("IQM", "iqm", note="IQM: mean without the lowest and highest quarter of seeds."),
        estimate(
            "over the run",
            "over_run",
            note="Over the run: IQM of the mean return over all control steps.",
        ),
        estimate(
            "s", "s", note="s: standard deviation between agents, without that of the episodes."
        ),
        number(
            "detectable",
            "detectable",
            note="Detectable: smallest difference that these seeds would show.",
        ),
        Column(f"reach {SOLVED}", "reached", "{0[reached]} of {0[seeds]}".format, True),
        estimate(f"steps to {SOLVED}", "solved_steps", steps),
        number("published median", "published"),
    ]
    title = f"Final {frames.returns} returns"
    sentences = [_final(frames), _INTERVAL]
    if frames.request.curves:
        title = "Final returns by method"
    if len(policies):
        fewest = int(policies["episodes"].min())
        sentences.append(f"Random and hand-written policies: {fewest} episodes or more.")
    if NORMALIZED in {*agents["task"]}:
        sentences.append("Normalized: 0 is the lowest and 1 the highest return of a task.")

    return Table("final_returns", title, " ".join(sentences), rows, columns)


def _count(value: int) -> str:
    return str(value or "")


def for_paper(table: Table, frames: Frames) -> Table:
    """Returns a table as LaTeX has it: final returns with the columns that were asked for.

    Raises a RequestError if there is no such column.
    """
    asked = frames.request.table_columns
    if table.name != "final_returns" or asked == ("all",):
        return table
    return table.of(asked or ("task", _agent(frames).title, OBSERVED.title, "seeds", "median"))


def _verdicts(frames: Frames) -> Table:
    """Returns the table of verdicts: each reduced representation against its baselines."""
    rows = frames.lead(frames.verdicts)
    columns = [
        _TASK,
        _ALGO,
        OBSERVED,
        plain("against"),
        Column("of", "claim", lambda row: COMPARED[row["claim"]]),
        Column("verdict", "verdict", "{0[mark]} {0[text]}".format),
        number("difference", "value", signed, ("low", "high")),
        _SEEDS,
        plain("corrected by", "corrected_by"),
    ]
    caption = (
        f"{frames.returns.capitalize()} returns at the last control step that every seed has "
        "reached. A verdict rests on an interval that is corrected for the other comparisons; the "
        f"95% interval of the difference alone is beside it. Similar: within {MARGIN:g}. Fewer "
        f"than {DECIDING_SEEDS} seeds decide nothing."
    )
    return Table("verdicts", "Does reduction help?", caption, rows, columns)


def _decisions(frames: Frames) -> Table:
    """Returns the table of what the sequential test decides on the comparisons of studies."""

    def against(row: Row) -> str:
        return ", ".join(filter(None, (row["against"], row["against_words"])))

    columns = [
        plain("study"),
        _TASK,
        _ALGO,
        OBSERVED,
        Column("against", "against", against),
        Column("of", "claim", lambda row: COMPARED[row["claim"]]),
        plain("verdict"),
        _SEEDS,
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


def _comparisons(frames: Frames) -> Table:
    """Returns the table of the comparisons that were asked for, of two sides or of methods."""
    columns = [
        _TASK,
        _ALGO,
        OBSERVED,
        *([] if frames.request.curves else [plain("returns")]),
        plain("this", "a"),
        plain("against", "b"),
        Column("seeds", "seeds_a", "{0[seeds_a]}, {0[seeds_b]}".format, True),
        number("steps", "steps", steps),
        estimate("probability", "p", ratio),
        number("difference", "difference", signed, ("low", "high")),
        plain("verdict", "text"),
    ]
    caption = (
        "Final returns at the last control step that every seed of both sides has reached: "
        "probability that a run of the first has a higher one than a run of the second, and "
        f"difference of the interquartile means. {_INTERVAL} The verdict is corrected for the "
        "number of rows."
    )
    title = "Comparison of methods" if frames.request.curves else "Comparison of two sides"
    return Table("comparisons", title, caption, frames.comparisons, columns)


def _claims(frames: Frames) -> Table:
    """Returns the table of the tests of the paper's claims."""
    needed = "{0[seeds_needed]:,} ({0[seeds_needed_by]})".format
    columns = [
        Column("claim", "claim", "({0[claim]})".format),
        plain("runs", "source"),
        plain("returns"),
        plain("compared"),
        _SEEDS,
        plain("verdict", "text"),
        number("by episodes alone", "by_episodes", ratio),
        Column("seeds that would decide", "seeds_needed", needed, True),
        plain("remark"),
    ]
    claims = paper_claims().itertuples()
    tests = " ".join(f"({letter}) {text} {test}" for letter, text, test in claims)
    caption = f"{tests} In brackets: 95% interval, 90% for (a)."
    return Table("claims", "The paper's claims", caption, frames.claims, columns)


def leaderboard_table(frame: pd.DataFrame, returns: str) -> Table:
    """Returns the leaderboard by one kind of return."""
    columns = [
        _TASK,
        number("rank", "rank", str),
        plain("entry"),
        _ALGO,
        plain("representation"),
        number("median", "median", ends=("low", "high")),
        number("n", "n", str),
        _RANGE,
    ]
    caption = (
        f"{_FINAL[returns]} Medians. {_INTERVAL} Entries whose intervals overlap share a rank; "
        f"those with fewer than {DECIDING_SEEDS} seeds have none. Published medians are training "
        "returns at the end of the paper's curves. Entries may have been trained for different "
        "numbers of control steps."
    )
    return Table("leaderboard", f"Leaderboard by final {returns} return", caption, frame, columns)


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
        _TASK,
        plain("encoder", "representation"),
        plain("settings"),
        number("latents", "latents", str),
        _SEEDS,
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

    def status(row: Row) -> str:
        known = "" if row["source"] == FILE else str(row["status"])
        return "diverged" if row["diverged"] else known

    columns = [
        _TASK,
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
