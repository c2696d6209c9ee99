"""Rows of a run that was computed again, beside the recorded ones, bit for bit."""

import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record
from jbench.store.schema import TIMES
from jbench.training.log import POLICY_EVALUATION

RepeatVerdict = Literal["equal", "different", "no policy", "not comparable"]
"""Whether returns are the recorded ones, bit for bit; `not comparable`: the record or this
machine lacks what is needed to repeat its last evaluation."""


RowKind = Literal["episode", "evaluation"]
"""What a row is about: an episode of the training, or one of an evaluation."""


class RowKey(NamedTuple):
    """What names a row of a run; rows in the order of their keys are in that of the training.

    `number` counts the episodes or evaluations of the run, and `episode` those of an evaluation.
    """

    control_steps: int
    kind: RowKind
    number: int
    episode: int


Rows = dict[RowKey, Mapping[str, Any]]
"""Rows of a run, each with its columns."""


class Repeated(NamedTuple):
    """A part of a run that was computed again: its last evaluation, or its first episodes.

    Attributes:
        run: id of the run.
        verdict: on the returns.
        reason: a sentence on why they are not comparable, or how they differ; otherwise empty.
        control_steps: where the part ends; None if it was not computed again.
        recorded: returns of its episodes in the database.
        computed: returns of its episodes here.
    """

    run: str
    verdict: RepeatVerdict
    reason: str = ""
    control_steps: int | None = None
    recorded: tuple[float, ...] = ()
    computed: tuple[float, ...] = ()


def read_rows(record: Record, *kinds: RowKind, until: float = math.inf) -> Rows:
    """Returns the rows of a run up to a control step, without what differs between machines."""
    rows: Rows = {}
    for kind in kinds:
        for row in record.read(f"{kind}s").drop_columns([*TIMES, "run"]).to_pylist():
            control_steps = row["control_steps"]
            number = row[kind]
            if None not in (control_steps, number) and control_steps <= until:
                rows[RowKey(control_steps, kind, number, row["episode"])] = row
    return rows


def is_of_last_evaluation(
    record: Record, settings: RunSettings | ExternalSettings, rows: Rows
) -> bool:
    """Returns whether the kept policy is the one that the last evaluation had."""
    newest = max(key.number for key in rows)
    evaluated = record.manifest.summary.get(POLICY_EVALUATION)
    if evaluated is not None or not isinstance(settings, RunSettings):
        return bool(evaluated == newest)

    # Older versions did not record it. They kept the policy after the last updates, which was
    # evaluated only if no evaluation was due at the last control step.
    previous, last = [0, *sorted({key.control_steps for key in rows})][-2:]
    return last // settings.evaluate_every == previous // settings.evaluate_every


def without_early_final(rows: Rows, record: Record, episodes: int) -> Rows:
    """Returns rows of a run whose evaluations but the last one have at most some `episodes`.

    With stable-baselines3, older versions made each evaluation in the rollout after the last of the
    requested control steps as long as the last one; its first episodes are those of a shorter one.
    """
    numbers = record.read("evaluations")["evaluation"].to_pylist()
    last = max(filter(None, numbers), default=0)
    return {
        key: row
        for key, row in rows.items()
        if key.kind != "evaluation" or key.number == last or key.episode < episodes
    }


def compared(
    record: Record,
    until: int,
    recorded: Rows,
    computed: Rows,
    kind: RowKind,
) -> Repeated:
    """Compares rows in the order of training; the reason is a sentence on the first difference.

    The returns are those of one kind of rows.
    """
    reason = _first_difference(recorded, computed)
    return Repeated(
        record.id,
        "different" if reason else "equal",
        reason,
        until,
        recorded=_returns(recorded, kind),
        computed=_returns(computed, kind),
    )


def _first_difference(recorded: Rows, computed: Rows) -> str:
    """Returns a sentence on the first value that differs; "" if all computed ones are equal."""
    for key in sorted(recorded.keys() | computed.keys()):
        then = recorded.get(key)
        now = computed.get(key)
        where = f"{key.kind} {key.number}, at control step {key.control_steps:,}"
        if then is None:
            return f"A row of {where}, is missing in the record."
        if now is None:
            return f"A row of {where}, is missing here."

        for column in now:
            before = repr(then[column])  # one nan is as another
            here = repr(now[column])
            if before != here:
                values = f"recorded {before}, here {here}"
                return f"The first difference is {column} of {where}: {values}."
    return ""


def _returns(rows: Rows, kind: RowKind) -> tuple[float, ...]:
    """Returns the returns of the rows of a kind, in the order of training."""
    return tuple(row["episode_return"] for key, row in sorted(rows.items()) if key.kind == kind)
