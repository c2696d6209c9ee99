"""Computes the last evaluation or first episodes of a run again; compares its rows bit for bit."""

import math
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from jbench.cores import one_thread
from jbench.devices import find_device
from jbench.errors import RequestError
from jbench.policies.saved import has_policy, load_agent
from jbench.settings.engines import ENGINES
from jbench.settings.recorded import Run, Unreadable, read_run
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results, schema
from jbench.store.code import ChangedCodeError, changed_since, check_code, code_hash, have_changed
from jbench.store.merge import TIMES
from jbench.store.provenance import device_provenance, differences, provenance
from jbench.training.batched_run import run_batch
from jbench.training.code import run_code
from jbench.training.engines import acting_as_evaluated
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.events import EpisodeEnded, Event
from jbench.training.log import POLICY_EVALUATION

RepeatVerdict = Literal["equal", "different", "no policy", "not comparable"]
"""Whether returns are the recorded ones, bit for bit; `not comparable`: the record or this
machine lacks what is needed to repeat its last evaluation."""

_Rows = dict[tuple[int, str, int, int], Mapping[str, Any]]
"""By control steps, "episode" or "evaluation", its number, episode of the evaluation."""


class Repeated(NamedTuple):
    """A part of a run that was computed again: its last evaluation, or its first episodes.

    The reason is a sentence on why it is not comparable, or how it differs; otherwise it is empty.
    The part ends at `control_steps`, None if it was not repeated. `recorded` and `computed` are the
    returns of its episodes in the database and here.
    """

    run: str
    verdict: RepeatVerdict
    reason: str = ""
    control_steps: int | None = None
    recorded: tuple[float, ...] = ()
    computed: tuple[float, ...] = ()


def changed_code(record: Record, results: Results, accept_changed: bool) -> list[str]:
    """Returns what has changed of the users' code of a run; a ChangedCodeError unless accepted."""
    settings = read_run(record.settings)
    if isinstance(settings, Unreadable):
        return []
    now = run_code(settings, results)
    if not accept_changed:
        check_code(record, now)
    return changed_since(record, now)


def reevaluate(results: Results, record: Record, accept_changed: bool = False) -> Repeated:
    """Repeats the last evaluation of a finished run: the same initial states, with the kept policy.

    On the same kind of processor with the same versions, the returns are the same bits. The results
    contain its encoder. A run whose users' code has changed is not comparable, unless that is
    accepted. Raises a WorkError if a file of the run is damaged.
    """
    if not has_policy(record):
        return Repeated(record.id, "no policy", "It was saved without its policy.")
    settings = read_run(record.settings)
    rows = _rows(record, "evaluation")
    obstacle = _obstacle(record, settings, rows)
    if isinstance(settings, Unreadable) or obstacle:
        return Repeated(record.id, "not comparable", obstacle)
    number = max(number for _, _, number, _ in rows)
    recorded = {key: row for key, row in rows.items() if key[2] == number}
    control_steps = max(steps for steps, *_ in recorded)
    try:
        if changed_code(record, results, accept_changed) and isinstance(settings, RunSettings):
            settings = settings.model_copy(update={"accepted": "repeated"})
        agent = load_agent(results, record.id, accept_changed)
        device = _device(record, at_end=True)
        with one_thread(), acting_as_evaluated(settings, agent, control_steps, device) as act:
            (evaluation,) = evaluate_policies(
                settings,
                [derive_seeds(settings.seed)[1]],
                number,
                act,
                control_steps=control_steps,
                episodes=max(len(recorded), settings.evaluate_episodes),
            )
    except ChangedCodeError as error:
        return Repeated(record.id, "not comparable", str(error))
    except (RequestError, ValueError) as error:
        reason = f"Its policy can't be run: {str(error).rstrip('.')}."
        return Repeated(record.id, "not comparable", reason)
    if evaluation.failure is not None:
        return Repeated(record.id, "not comparable", str(evaluation.failure))
    computed: _Rows = {
        (control_steps, "evaluation", number, episode): {"episode_return": episode_return}
        for episode, episode_return in enumerate(evaluation.returns.tolist())
    }
    repeated = _compared(record, control_steps, recorded, computed, "evaluation")
    if files := changed_code(record, results, accept_changed):
        reason = f"With changed code ({have_changed(files)}). {repeated.reason}".rstrip()
        return repeated._replace(reason=reason)
    return repeated


def _show_episode(progress: Callable[[int], None], event: Event) -> None:
    """Passes on the control step at which an episode ended."""
    if isinstance(event, EpisodeEnded):
        progress(event.steps)


def retrain(
    results: Results,
    record: Record,
    episodes: int,
    progress: Callable[[int], None] = lambda control_steps: None,
    accept_changed: bool = False,
) -> Repeated:
    """Trains the first episodes of a run again, in a temporary directory.

    The results contain its encoder. Episodes of parallel environments may end together, so that
    they may be a few more. Raises a RequestError if it has no episode, its loop was not jbench's,
    or its encoder is missing, and a WorkError if the run is damaged, or its training fails here.
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
    if changed_code(record, results, accept_changed):
        now = code_hash(run_code(settings, results))
        settings = settings.model_copy(update={"accepted": now})
    ends = record.read("episodes")["control_steps"].to_pylist()
    until = ends[min(episodes, len(ends)) - 1]
    recorded = _rows(record, "episode", "evaluation", until=until)
    evaluations = [number for _, kind, number, _ in recorded if kind == "evaluation"]
    with one_thread(), tempfile.TemporaryDirectory(prefix="jbench-") as directory:
        temporary = Results(Path(directory))
        failures = run_batch(
            [settings],
            temporary,
            encoders=results,
            device=_device(record),
            until=until if until < settings.steps else None,
            final_episodes=evaluations.count(max(evaluations)) if evaluations else None,
            report=partial(_show_episode, progress),
        )
        for failure in failures.values():
            raise failure
        new = temporary.find("run", settings.id)
        assert new is not None
        computed = _rows(new, "episode", "evaluation", until=until)
    repeated = _compared(record, until, recorded, computed, "episode")
    losses = (row.get(name) for row in computed.values() for name in schema.LOSSES)
    if repeated.verdict == "equal" and all(loss is None for loss in losses):
        reason = "The agent was not updated in them; repeat more episodes."
        return repeated._replace(reason=reason)
    return repeated


def default_episodes(record: Record) -> int:
    """Returns how many episodes to train again: up to the first updates, and at least one."""
    rows = record.read("episodes")
    losses = np.column_stack([rows[name].is_valid().to_numpy() for name in schema.LOSSES])
    updated = np.flatnonzero(losses.any(axis=1))
    return int(updated[0]) + 1 if len(updated) else 1


def changes_since(record: Record) -> dict[str, list[Any]]:
    """Returns what may round numbers differently: its values when the run began, and now."""
    now = {**provenance(), **device_provenance(find_device(_device(record)))}
    return differences(record.manifest.provenance, now)


def _device(record: Record, at_end: bool = False) -> str:
    """Returns the device on which a run began or ended, if it exists here; otherwise `cpu`."""
    on_gpu = _recorded_device(record, at_end) == "cuda"
    return find_device("auto" if on_gpu else "cpu").type


def _recorded_device(record: Record, at_end: bool) -> str:
    made = record.manifest.provenance
    continued = made.get("continued") if at_end else None
    changed = continued[-1]["changed"] if continued else {}  # since the beginning
    return str(changed.get("device", [made.get("device", "cpu")])[-1])


def _obstacle(record: Record, settings: Run, rows: _Rows) -> str:
    """Returns why the kept policy can't be compared with the evaluations; "" if it can."""
    if isinstance(settings, Unreadable):
        return "Another program or version wrote its settings."
    if not rows:
        return "It has no evaluation."
    if _recorded_device(record, at_end=True) != _device(record, at_end=True):
        return "A GPU evaluated it, and this machine has none."
    if not ENGINES[settings.engine].copies_round_alike:
        return "Its evaluations ran the agent's own code; the kept copy rounds sums differently."
    newest = max(number for _, _, number, _ in rows)
    evaluated = record.manifest.summary.get(POLICY_EVALUATION)
    if evaluated is None and isinstance(settings, RunSettings):
        # Older versions did not record it. They kept the policy after the last updates, which was
        # evaluated only if no evaluation was due at the last control step.
        previous, last = [0, *sorted({steps for steps, *_ in rows})][-2:]
        if last // settings.evaluate_every == previous // settings.evaluate_every:
            evaluated = newest
    if evaluated != newest:
        return (
            "Its last evaluation was not made with the policy that was kept: with one before the "
            "last updates, as in older versions of jbench, or with a function of the caller."
        )
    return ""


def _rows(record: Record, *kinds: str, until: float = math.inf) -> _Rows:
    return {
        (row["control_steps"], kind, row[kind], row["episode"]): row
        for kind in kinds
        for row in record.read(f"{kind}s").drop_columns([*TIMES, "run"]).to_pylist()
        if None not in (row["control_steps"], row[kind]) and row["control_steps"] <= until
    }


def _compared(record: Record, until: int, recorded: _Rows, computed: _Rows, what: str) -> Repeated:
    """Compares rows in the order of training; the reason is a sentence on the first difference."""
    returns = [
        tuple(row["episode_return"] for key, row in sorted(rows.items()) if key[1] == what)
        for rows in (recorded, computed)
    ]
    for key in sorted(recorded.keys() | computed.keys()):
        then, now = recorded.get(key), computed.get(key)
        where = f"{key[1]} {key[2]}, at control step {key[0]:,}"
        if then is None or now is None:
            reason = f"A row of {where}, is missing {'in the record' if then is None else 'here'}."
            return Repeated(record.id, "different", reason, until, *returns)
        for column in now:
            before, here = repr(then[column]), repr(now[column])  # nan is no other nan
            if before != here:
                values = f"recorded {before}, here {here}"
                reason = f"The first difference is {column} of {where}: {values}."
                return Repeated(record.id, "different", reason, until, *returns)
    return Repeated(record.id, "equal", "", until, *returns)
