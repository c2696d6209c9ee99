"""Trains the first episodes of a run again, and compares them with its rows bit for bit."""

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jbench.cores import one_thread
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.recorded import read_run
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results, schema
from jbench.store.merge import TIMES
from jbench.training.batched_run import run_batch
from jbench.training.environment import load_run_encoder
from jbench.training.reevaluate import Repeated, Verdict, device_for

_Rows = dict[tuple[int, str, int, int], dict[str, Any]]
"""By control steps, "episode" or "evaluation", its number, episode of the evaluation."""


def default_episodes(record: Record) -> int:
    """Returns how many episodes to train again: up to the first updates, and at least one."""
    rows = record.read("episodes")
    losses = np.column_stack([rows[name].is_valid().to_numpy() for name in schema.LOSSES])
    updated = np.flatnonzero(losses.any(axis=1))
    return int(updated[0]) + 1 if len(updated) else 1


def settings_to_train(record: Record) -> RunSettings:
    """Returns the settings of a run whose training can be repeated.

    Raises:
        RequestError: if it has no episode, or its loop was not jbench's.
    """
    settings = read_run(record.settings)
    if isinstance(settings, ExternalSettings):
        raise RequestError(
            f"{record.id} was trained by a loop that jbench does not have: only its evaluation "
            "can be repeated; type --episodes 0."
        )
    if not isinstance(settings, RunSettings):
        raise RequestError(f"Another program or version wrote the settings of {record.id}.")
    if not record.rows("episodes"):
        raise RequestError(f"{record.id} is {record.status} and has no episode to compare with.")
    return settings


def retrain(
    results: Results,
    record: Record,
    episodes: int,
    progress: Callable[[int], None] = lambda control_steps: None,
) -> Repeated:
    """Trains the first episodes of a run again, in a temporary directory.

    Args:
        results: results directory of the run; contains its encoder.
        episodes: number of training episodes. Parallel environments end theirs together, so that
            it may be a few more.
        progress: called with the control steps trained so far.

    Raises:
        RequestError: as `settings_to_train`, or if the encoder is missing.
        WorkError: if the run is damaged, or its training fails here.
    """
    settings = settings_to_train(record)
    rounds = math.ceil(min(episodes, record.rows("episodes")) / settings.environments)
    until = rounds * EPISODE_STEPS * settings.environments
    with one_thread(), tempfile.TemporaryDirectory(prefix="jbench-") as directory:
        temporary = Results(Path(directory))
        _train(results, record, settings, until, temporary, progress)
        trained = temporary.find("run", settings.id)
        if trained is None:
            raise WorkError(f"{settings.id} could not be trained again.")
        theirs, ours = _rows(record, until), _rows(trained, until)
    reason = _difference(theirs, ours)
    verdict: Verdict = "different" if reason else "equal"
    if not reason and all(row.get(name) is None for row in ours.values() for name in schema.LOSSES):
        reason = "The agent was not updated in them; repeat more episodes."
    returns = (
        tuple(row["episode_return"] for key, row in rows.items() if key[1] == "episode")
        for rows in (theirs, ours)
    )
    return Repeated(record.id, verdict, reason, until, *returns)


def _train(
    results: Results,
    record: Record,
    settings: RunSettings,
    until: int,
    temporary: Results,
    progress: Callable[[int], None],
) -> None:
    """Trains a run up to a control step, in a temporary results directory."""
    stop = until if until < settings.steps else None
    encoder = load_run_encoder(settings, results)
    if settings.engine == "sb3":
        from jbench.training import sb3_run  # stable-baselines3 takes a second to import

        sb3_run.run(settings, temporary, encoder, lambda event: progress(event.steps), until=stop)
        return
    failures = run_batch(
        [settings],
        temporary,
        encoder,
        device=device_for(record.manifest.provenance),
        until=stop,
        report=lambda event: progress(event.steps),
    )
    for failure in failures.values():
        raise failure


def _rows(record: Record, until: int) -> _Rows:
    """Returns the rows of training and evaluations up to a control step, without times."""
    return {
        (row["control_steps"], number, row[number], row["episode"]): row
        for table, number in (("episodes", "episode"), ("evaluations", "evaluation"))
        for row in record.read(table).drop_columns([*TIMES, "run"]).to_pylist()
        if None not in (row["control_steps"], row[number]) and row["control_steps"] <= until
    }


def _difference(recorded: _Rows, computed: _Rows) -> str:
    """Returns a sentence on the first row that differs, in the order of training; "" if none."""
    for key in sorted(recorded.keys() | computed.keys()):
        theirs, ours = recorded.get(key), computed.get(key)
        control_steps, what, number, _ = key
        where = f"{what} {number}, at control step {control_steps:,}"
        if theirs is None or ours is None:
            return f"A row of {where}, is missing {'in the record' if theirs is None else 'here'}."
        for column in ours:
            if not _equal(theirs[column], ours[column]):
                values = f"recorded {theirs[column]!r}, here {ours[column]!r}"
                return f"The first difference is {column} of {where}: {values}."
    return ""


def _equal(recorded: object, computed: object) -> bool:
    """Returns whether two values are the same; NaN is NaN."""
    return recorded == computed or (recorded != recorded and computed != computed)
