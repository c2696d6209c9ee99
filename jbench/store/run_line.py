"""A run, or an imported curve, as lists show it: from its manifest and, for returns, its rows."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.names import ReturnsName
from jbench.returns import EVALUATION, diverged_return, final_return, last_evaluation_return
from jbench.settings.recorded import read_run, recorded_episode_steps
from jbench.store.evaluations import evaluation_returns
from jbench.store.record import Record
from jbench.store.roles import CHECKPOINT
from jbench.store.rows import has_diverged, has_policy, make_row


@dataclass(frozen=True)
class RunLine:
    """A run, or an imported curve, as lists show it; None is what is unknown.

    Its final returns are None until the episodes are read: see `line_with_returns`.

    Attributes:
        run: id of the run or of the import.
        episodes: number of committed training episodes, or of an import's points.
        steps_done: control steps of the committed episodes, or of the finished run.
        steps: planned control steps.
        wall_time: of the training, in s.
        returns: kind of return of an import.
        error: why a failed run failed.
        variant: hash of the settings but seed and steps; in a list, the settings in which its runs
            of the same algorithm and representation differ, as in legends.
        last_return: final return of training, or of an import's kind.
        evaluation_return: mean return of the last evaluation, with the episodes of `jbench
            evaluate` that have joined it.
        evaluation_return_at_end: the same without these episodes.
        has_policy: whether the results have its policy; False for an import.
    """

    run: str
    task: str | None
    algo: str | None
    representation: str | None
    seed: int | None
    status: str
    episodes: int
    steps_done: float
    steps: int | None
    wall_time: float | None
    created: str
    updated: str
    returns: ReturnsName | None
    error: str | None
    variant: str | None
    last_return: float | None = None
    evaluation_return: float | None = None
    evaluation_return_at_end: float | None = None
    has_policy: bool = False

    def matches(self, filters: Mapping[str, Collection[Any]]) -> bool:
        """Returns whether each field that is filtered has one of the allowed values."""
        return all(getattr(self, name) in values for name, values in filters.items())


def make_line(record: Record) -> RunLine:
    """Returns the line of a run or an import, without its final returns; raises as `make_row`."""
    row = make_row(record)
    summary = record.manifest.summary
    if record.kind == "import":
        episodes = row["points"] or 0
        done = _known(summary.get("control_steps")) or 0
    else:
        episodes = row["episodes"]
        done = _known(summary.get("steps_done"))
        if done is None:
            done = _recorded_steps(record)

    return RunLine(
        run=record.id,
        task=row["task"],
        algo=row["algo"],
        representation=row["representation"],
        seed=row["seed"],
        status=row["status"],
        episodes=episodes,
        steps_done=done,
        steps=row.get("steps"),
        wall_time=_known(row.get("wall_time")),
        created=row["created"],
        updated=row["updated"],
        returns=row.get("returns"),
        error=record.error,
        variant=row.get("variant"),
        has_policy=has_policy(record),
    )


def line_with_returns(record: Record, added: Sequence[NDArray[np.float64]]) -> RunLine:
    """Returns the line of a record with its final returns.

    Those of a run that diverged are its `diverged_return`, of evaluations only if any were planned.

    Args:
        record: of a run or an import.
        added: what `jbench evaluate` has added to the run; see `added_returns`.

    Raises:
        DamagedError: as `make_row`.
        WorkError: if rows can't be read; `Record.reading` tries again.
    """
    line = make_line(record)
    if record.kind == "import":
        return _import_with_returns(line, record)

    rows = record.read("episodes")
    if line.wall_time is None and len(rows):
        line = replace(line, wall_time=_known(rows["wall_time"][-1].as_py()))

    training = rows["episode_return"].to_numpy()
    if has_diverged(record.manifest):
        counted = diverged_return(training, str(line.task))
        planned = read_run(record.settings).evaluate_episodes or record.rows("evaluations")
        evaluation = counted if planned else None
        return _with_returns(line, counted, evaluation, evaluation)

    return _with_returns(
        line,
        final_return(training),
        last_evaluation_return(*evaluation_returns(record, added)),
        last_evaluation_return(*evaluation_returns(record)),
    )


def _import_with_returns(line: RunLine, record: Record) -> RunLine:
    """Returns the line of an imported curve with its final return, of the kind that it has."""
    points = record.read("import_points").to_pandas()
    returns = points.groupby("point")["episode_return"].mean().to_numpy(np.float64)
    if line.returns == EVALUATION:
        last = final_return(returns, EVALUATION)
        return _with_returns(line, last, last, last)

    return _with_returns(line, final_return(returns), None, None)


def _with_returns(
    line: RunLine, last: float | None, evaluation: float | None, at_end: float | None
) -> RunLine:
    """Returns a line with its three final returns."""
    return replace(
        line,
        last_return=_known(last),
        evaluation_return=_known(evaluation),
        evaluation_return_at_end=_known(at_end),
    )


def _known(number: Any) -> Any:
    """Returns a number of a manifest, which is untrusted; None if it is no finite number."""
    return number if isinstance(number, int | float) and math.isfinite(number) else None


def committed_steps(record: Record) -> int:
    """Returns the control steps of a run up to its last commit.

    They are those of its newest checkpoint. Without one they follow from the number of episodes,
    as if none had ended before its time limit.
    """
    matches = filter(None, map(CHECKPOINT.fullmatch, record.roles()))
    saved = [int(match[1]) for match in matches]
    if saved:
        return max(saved)

    made = record.rows("episodes") * recorded_episode_steps(record.settings)
    planned = record.settings.get("steps")
    return min(made, planned) if isinstance(planned, int) else made


def _recorded_steps(record: Record) -> int:
    """Returns the control steps of a run that rows are of.

    A run that failed has rows of the episodes after its newest checkpoint, too.
    """
    if record.status != "failed" or not record.rows("episodes"):
        return committed_steps(record)
    last: int = record.read("episodes")["control_steps"][-1].as_py()
    return last
