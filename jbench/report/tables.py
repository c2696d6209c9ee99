"""The tables of a report."""

from collections.abc import Iterator

import pandas as pd

from jbench.report.analysis.claims import CLAIMS
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.cells import OWN
from jbench.report.data.returns import SOLVED, ratio, signed, steps
from jbench.report.encoders import PREDICTED
from jbench.report.frames import Frames
from jbench.report.table import (
    WRITERS,
    Column,
    Row,
    Table,
    estimate,
    missing,
    number,
    plain,
    to_csv,
)

_INTERVAL = "In brackets: 95% interval."

DATA = (
    *("configurations", "seeds", "curves", "published", "baselines", "pairs", "profiles"),
    *("predictions", "processor", "motor", "positions", "sequences"),
)
"""Frames of figures, whose numbers are written as CSV."""


def tables(frames: Frames) -> list[Table]:
    """Returns the tables of a report that have rows, in the order of the page."""
    every = [
        _final_returns(frames),
        _verdicts(frames),
        _comparisons(frames),
        _claims(frames),
        leaderboard_table(frames.leaderboard, frames.returns),
        _encoders(frames),
        _runs(frames),
    ]
    return [table for table in every if len(table.frame)]


_TASK, _ALGO = plain("task"), plain("algorithm", "algo")


def _observation(row: Row) -> str:
    return ", ".join(filter(None, (row["representation"], row["words"])))


def _sourced(row: Row) -> str:
    return str(row["algo"]) if row["source"] == OWN else f"{row['source']}: {row['algo']}"


def _steps(row: Row) -> str:
    if missing(row["steps"]):
        return ""
    ends = dict.fromkeys((steps(row["steps_min"]), steps(row["steps"])))
    return "\N{EN DASH}".join(ends)


def _reached(row: Row) -> str:
    return "" if missing(row["reached"]) else f"{row['reached']} of {row['seeds']}"


def _final_returns(frames: Frames) -> Table:
    """Returns the table of configurations, with the policies beside the agents."""
    agents = frames.configurations
    agents = agents[agents["returns"] == frames.returns]
    policies = frames.baselines.assign(source=OWN, representation="", words="")
    policies = policies.assign(algo=policies["policy"].replace("random", "random actions"))
    policies = policies.rename(columns={"low": "median_low", "high": "median_high"})
    counts = dict.fromkeys(("seeds", "draws", "diverged", "reached", "steps_min", "steps"), "Int64")
    agents, policies = (
        one.reindex(columns=agents.columns).astype(counts) for one in (agents, policies)
    )
    rows = pd.concat([agents, policies], ignore_index=True)
    order = {task: i for i, task in enumerate(agents["task"].unique())}
    rows = rows.sort_values("task", key=lambda task: task.map(order), kind="stable")
    return Table(
        "final_returns",
        f"Final {frames.returns} returns",
        f"{_FINAL[frames.returns]} IQM: mean without the lowest and highest quarter of seeds. s: "
        "standard deviation between agents, without that of the episodes. Detectable: smallest "
        f"difference that these seeds would show. {_INTERVAL} Policies have 100 episodes.",
        rows,
        (
            _TASK,
            Column("algorithm", "algo", _sourced),
            Column("observation", "representation", _observation),
            number("seeds", "seeds", str),
            number("draws", "draws", lambda value: str(value) if value else ""),
            Column("steps", "steps", _steps, numeric=True),
            number("diverged", "diverged", lambda value: str(value) if value else ""),
            estimate("median", "median"),
            estimate("IQM", "iqm"),
            estimate("over the run", "over_run"),
            estimate("s", "s"),
            number("detectable", "detectable"),
            Column(f"reach {SOLVED}", "reached", _reached, numeric=True),
            estimate(f"steps to {SOLVED}", "solved_steps", steps),
            number("published median", "published"),
        ),
    )


_FINAL = {
    "evaluation": "Mean return of a run's last evaluation, in which the policy is deterministic.",
    "training": "Mean return of a run's last 100 training episodes, exploration included, or of "
    "its last quarter if that is shorter.",
}
_CLAIM = {"a": "final return", "b": "variability across seeds", "c": "speed"}


def _verdicts(frames: Frames) -> Table:
    rows = frames.verdicts[frames.verdicts["returns"] == frames.returns]
    return Table(
        "verdicts",
        "Does reduction help?",
        f"{frames.returns.capitalize()} returns at the last control step that every seed has "
        "reached. Higher, lower, faster, slower and more or less variable: the 95% interval says "
        "so; similar: the 90% interval of the difference lies within 50. Fewer than "
        f"{DECIDING_SEEDS} seeds decide nothing.",
        rows,
        (
            _TASK,
            _ALGO,
            Column("observation", "representation", _observation),
            plain("against"),
            Column("of", "claim", lambda row: _CLAIM[row["claim"]]),
            Column("verdict", "verdict", lambda row: f"{row['mark']} {row['text']}"),
            number("seeds", "seeds", str),
        ),
    )


def _comparisons(frames: Frames) -> Table:
    return Table(
        "comparisons",
        "Comparison of two sides",
        "Final returns at the last control step that every seed of both sides has reached: "
        "probability that a run of the first ends above one of the second, and difference of the "
        f"interquartile means. {_INTERVAL}",
        frames.comparisons,
        (
            _TASK,
            _ALGO,
            Column("observation", "representation", _observation),
            plain("returns"),
            plain("this", "a"),
            plain("against", "b"),
            Column("seeds", "seeds_a", lambda row: f"{row['seeds_a']}, {row['seeds_b']}", True),
            number("steps", "steps", steps),
            estimate("probability", "p", ratio),
            estimate("difference", "difference", signed, ("low", "high")),
            plain("verdict", "text"),
        ),
    )


def _claims(frames: Frames) -> Table:
    tests = " ".join(f"({letter}) {claim.text} {claim.test}" for letter, claim in CLAIMS.items())
    return Table(
        "claims",
        "The paper's claims",
        f"{tests} In brackets: 95% interval, 90% for (a).",
        frames.claims,
        (
            Column("claim", "claim", lambda row: f"({row['claim']})"),
            plain("runs", "source"),
            plain("returns"),
            plain("compared"),
            number("seeds", "seeds", str),
            plain("verdict", "text"),
            number("by episodes alone", "by_episodes", ratio),
            Column("seeds that would decide", "seeds_needed", _needed, True),
            plain("remark"),
        ),
    )


def _needed(row: Row) -> str:
    if missing(row["seeds_needed"]):
        return ""
    return f"{row['seeds_needed']:,} ({row['seeds_needed_by']})"


def leaderboard_table(frame: pd.DataFrame, returns: str) -> Table:
    """Returns the leaderboard by one kind of return."""
    return Table(
        "leaderboard",
        f"Leaderboard by final {returns} return",
        f"{_FINAL[returns]} Medians. {_INTERVAL} Entries whose intervals cross share a rank; those "
        f"with fewer than {DECIDING_SEEDS} seeds have none. Published medians are training returns "
        "at the end of the paper's curves. Entries may have been trained for different numbers of "
        "control steps.",
        frame,
        (
            _TASK,
            number("rank", "rank", str),
            plain("entry"),
            _ALGO,
            plain("observation"),
            estimate("median", "median", ends=("low", "high")),
            number("n", "n", str),
            Column("steps", "steps", _steps, numeric=True),
        ),
    )


def _encoders(frames: Frames) -> Table:
    numbers = {
        "test": "not explained",
        "pca": "by PCA",
        "random": "by random projection",
        "heuristic": "heuristic's: not explained",
        "pca_heuristic": "heuristic's: by PCA",
        **{name: f"R² of {text}" for name, text in PREDICTED.items()},
    }
    return Table(
        "encoders",
        "What encoders lose",
        "Unexplained fraction of the variance of the scaled features, on held-out episodes and on "
        "the hand-written policy's; the fractions of ddae and planar do not compare with others. "
        "R²: the next control step, predicted from latents and action.",
        frames.encoders,
        (
            _TASK,
            plain("encoder", "representation"),
            plain("settings"),
            number("latents", "latents", str),
            number("seeds", "seeds", str),
            *(number(title, key, ratio) for key, title in numbers.items()),
        ),
    )


def _runs(frames: Frames) -> Table:
    return Table(
        "runs",
        "Runs",
        f"{_FINAL[frames.returns]}",
        frames.runs,
        (
            _TASK,
            Column("algorithm", "algo", _sourced),
            Column("observation", "representation", _observation),
            number("seed", "seed", str),
            number("steps", "steps", steps),
            number("final return", "final"),
            Column(
                "status", "status", lambda row: "diverged" if row["diverged"] else row["status"]
            ),
            plain("day"),
            plain("run"),
        ),
    )


def files(frames: Frames) -> Iterator[tuple[str, str]]:
    """Yields the name and the text of each file of tables."""
    for table in tables(frames):
        numbers = (
            table.frame.drop(columns=["settings", "provenance"])
            if table.name == "runs"
            else table.frame
        )
        yield f"{table.name}.csv", to_csv(numbers)
        for ending, write in WRITERS.items():
            if table.name != "runs":
                yield f"{table.name}.{ending}", write(table)
    for name in DATA:
        if len(frame := getattr(frames, name)):
            yield f"{name}.csv", to_csv(frame)
