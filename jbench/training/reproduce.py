"""Repeats a recorded run here, and compares it with its rows bit for bit."""

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from jbench.cores import one_thread
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.policies.find import SHIPPED
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings, read_run
from jbench.store import Record, Results, schema
from jbench.store.merge import TIMES
from jbench.store.provenance import device_provenance, differences, provenance
from jbench.store.shipped import shipped_results
from jbench.training.batched_run import run_batch
from jbench.training.environment import load_encoder_of
from jbench.training.reevaluate import Reevaluation, device_for, reevaluate
from jbench.wording import with_results

_Key = tuple[int, str, int, int]
"""Control steps, table, number of the episode or evaluation, episode of the evaluation."""


class Difference(NamedTuple):
    """The first value of a run that differs.

    Attributes:
        table: `episodes` (of training) or `evaluations`.
        number: of the episode or the evaluation.
        control_steps: of training, at its end.
        column: name of the value.
        recorded: value in the database; None if missing.
        computed: value here; None if missing.
    """

    table: str
    number: int
    control_steps: int
    column: str
    recorded: Any
    computed: Any

    def __str__(self) -> str:
        what = "episode" if self.table == "episodes" else "evaluation"
        return (
            f"{self.column} of {what} {self.number}, at control step {self.control_steps:,}: "
            f"recorded {_text(self.recorded)}, here {_text(self.computed)}"
        )


class Retraining(NamedTuple):
    """The first episodes of a run, trained again.

    Attributes:
        episodes: number of training episodes.
        evaluations: number of rows of evaluations.
        control_steps: at the end of these episodes.
        updated: whether the agent was updated before their end.
        difference: the first difference, or None.
    """

    episodes: int
    evaluations: int
    control_steps: int
    updated: bool
    difference: Difference | None


class Reproduction(NamedTuple):
    """Outcome of repeating a run.

    Attributes:
        run: id.
        evaluation: the last evaluation; None for a run that has not finished.
        retraining: the first episodes; None if none was to be trained.
        changed: value at the time of the run and now, of what may round numbers differently.
    """

    run: str
    evaluation: Reevaluation | None
    retraining: Retraining | None
    changed: Mapping[str, list[Any]]

    @property
    def equal(self) -> bool:
        """Whether nothing that was repeated differs."""
        retraining, evaluation = self.retraining, self.evaluation
        return (retraining is None or retraining.difference is None) and (
            evaluation is None or evaluation.verdict != "different"
        )

    @property
    def compared(self) -> bool:
        """Whether anything could be compared."""
        return self.retraining is not None or (
            self.evaluation is not None and self.evaluation.compared
        )


def find_run(results: Results, name: str) -> tuple[Results, Record]:
    """Returns a run and its results directory.

    Args:
        results: where the run is, unless it is a shipped one.
        name: id of the run or its beginning; after "reference/" those of a shipped run.

    Raises:
        RequestError: if there is no such run, or several.
        WorkError: if its manifest can't be read.
    """
    if name.startswith(SHIPPED):
        results = shipped_results()
    record = results.find("run", results.complete_id("run", name.removeprefix(SHIPPED)))
    if record is None:
        runs = with_results("jbench runs", results.name)
        raise RequestError(f"There is no run {name} in {results.name}; {runs} lists them.")
    return results, record


def default_episodes(record: Record) -> int:
    """Returns how many episodes to train again: up to the first updates, and at least one."""
    rows = record.read("episodes")
    losses = np.column_stack([rows[name].is_valid().to_numpy() for name in schema.LOSSES])
    updated = np.flatnonzero(losses.any(axis=1))
    return int(updated[0]) + 1 if len(updated) else 1


def reproduce(
    results: Results,
    record: Record,
    episodes: int,
    progress: Callable[[int], None] = lambda control_steps: None,
) -> Reproduction:
    """Repeats the last evaluation of a run, and trains its first episodes again.

    Everything is computed from the settings and the kept policy, in a temporary directory; the
    results are only read.

    Args:
        results: results directory of the run; contains its encoder.
        episodes: number of training episodes; 0 for none. Parallel environments end theirs
            together, so that it may be a few more.
        progress: called with the control steps trained so far.

    Raises:
        RequestError: if nothing can be repeated: there is neither a policy nor an episode, the
            loop was not jbench's own, or the encoder is missing.
        WorkError: if the run is damaged, or its training fails here.
    """
    settings = read_run(record.settings)
    if not isinstance(settings, RunSettings | ExternalSettings):
        raise RequestError(f"Another program or version wrote the settings of {record.id}.")
    if episodes and isinstance(settings, ExternalSettings):
        raise RequestError(
            f"{record.id} was trained by a loop that jbench does not have: only its evaluation "
            "can be repeated; type --episodes 0."
        )
    if episodes and not record.rows("episodes"):
        raise RequestError(f"{record.id} is {record.status} and has no episode to compare with.")
    evaluation = reevaluate(results, record) if record.status == "finished" else None
    if not episodes and (evaluation is None or evaluation.verdict == "no policy"):
        reason = "has not finished" if evaluation is None else "was saved without its policy"
        raise RequestError(f"{record.id} {reason}: type --episodes 1 or more.")
    retraining = None
    if episodes and isinstance(settings, RunSettings):
        with one_thread():
            retraining = _retrain(results, record, settings, episodes, progress)
    return Reproduction(record.id, evaluation, retraining, _changed(record))


def _changed(record: Record) -> dict[str, list[Any]]:
    recorded = record.manifest.provenance
    device = torch.device(device_for(recorded))
    return differences(recorded, {**provenance(), **device_provenance(device)})


def _retrain(
    results: Results,
    record: Record,
    settings: RunSettings,
    episodes: int,
    progress: Callable[[int], None],
) -> Retraining:
    round_steps = EPISODE_STEPS * settings.environments
    recorded = record.rows("episodes")
    rounds = math.ceil(min(episodes, recorded) / settings.environments)
    until = rounds * round_steps
    with tempfile.TemporaryDirectory(prefix="jbench-") as directory:
        again = _train(results, record, settings, until, progress, Results(Path(directory)))
        ours = {table: _rows(again, table, until) for table in schema.EPISODE_TABLES}
    theirs = {table: _rows(record, table, until) for table in schema.EPISODE_TABLES}
    computed = {**ours["episodes"], **ours["evaluations"]}
    found = _differences({**theirs["episodes"], **theirs["evaluations"]}, computed)
    return Retraining(
        len(ours["episodes"]),
        len(ours["evaluations"]),
        until,
        any(row[name] is not None for row in ours["episodes"].values() for name in schema.LOSSES),
        next(found, None),
    )


def _train(
    results: Results,
    record: Record,
    settings: RunSettings,
    until: int,
    progress: Callable[[int], None],
    temporary: Results,
) -> Record:
    """Trains a run up to a control step in a temporary results directory; returns its record."""
    stop = until if until < settings.steps else None
    encoder = load_encoder_of(settings, results)
    if settings.engine == "sb3":
        from jbench.training import sb3_run  # stable-baselines3 takes a second to import

        sb3_run.run(settings, temporary, encoder, lambda event: progress(event.steps), until=stop)
    else:
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
    trained = temporary.find("run", settings.id)
    if trained is None:
        raise WorkError(f"{settings.id} could not be trained again.")
    return trained


def _rows(record: Record, table: str, until: int) -> dict[_Key, dict[str, Any]]:
    """Returns the rows up to a control step, without times."""
    rows = record.read(table).drop_columns([*TIMES, "run"]).to_pylist()
    number = "episode" if table == "episodes" else "evaluation"
    keys = ((row["control_steps"], table, row[number], row["episode"]) for row in rows)
    keyed = zip(keys, rows, strict=True)
    return {key: row for key, row in keyed if None not in key and key[0] <= until}


def _differences(
    recorded: Mapping[_Key, Mapping[str, Any]], computed: Mapping[_Key, Mapping[str, Any]]
) -> Iterator[Difference]:
    """Yields the differences in the order of training."""
    for key in sorted(recorded.keys() | computed.keys()):
        control_steps, table, number, _ = key
        theirs, ours = recorded.get(key, {}), computed.get(key, {})
        for column in ours or theirs:
            values = theirs.get(column), ours.get(column)
            if not _equal(*values):
                yield Difference(table, number, control_steps, column, *values)


def _equal(one: Any, other: Any) -> bool:
    """Returns whether two values are the same; NaN equals NaN."""
    return bool(one == other or (one != one and other != other))


def _text(value: Any) -> str:
    return "nothing" if value is None else repr(value)
