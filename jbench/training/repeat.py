"""Computes the last evaluation or the first episodes of a run again, and compares the rows."""

import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from statistics import fmean

import numpy as np

from jbench.cores import one_thread
from jbench.errors import RequestError
from jbench.policies.saved import TrainedAgent, load_agent
from jbench.settings.engines import ENGINES
from jbench.settings.recorded import Run, Unreadable, read_run
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results, schema, weights
from jbench.store.code import (
    ChangedCodeError,
    code_hash,
    have_changed,
)
from jbench.store.rows import has_policy
from jbench.tasks.task import Act
from jbench.training.batched_run import run_batch
from jbench.training.changes import changed_code, device_here, is_installed, recorded_device
from jbench.training.code import run_code
from jbench.training.engines import acting_as_evaluated
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.events import EpisodeEnded, Event
from jbench.training.repeated_rows import (
    Repeated,
    RowKey,
    Rows,
    compared,
    is_of_last_evaluation,
    read_rows,
    without_early_final,
)


def episodes_to_repeat(record: Record) -> int:
    """Returns the number of episodes that `reevaluate` runs; 0 if the run is not comparable."""
    rows = read_rows(record, "evaluation")
    if _obstacle(record, read_run(record.settings), rows) is not None:
        return 0

    _, last = _last_evaluation(rows)
    return 1 + max(key.episode for key in last)


def reevaluate(
    results: Results,
    record: Record,
    accept_changed: bool = False,
    show_done: Callable[[int], None] | None = None,
) -> Repeated:
    """Repeats the last evaluation of a finished run: the same initial states, with the kept policy.

    On the same kind of processor with the same versions, the returns are the same bits. The results
    contain its encoder. A run whose users' code has changed is not comparable, unless that is
    accepted. `show_done` is called with the number of ended episodes. Raises a WorkError if a file
    of the run is damaged.
    """
    settings = read_run(record.settings)
    rows = read_rows(record, "evaluation")
    obstacle = _obstacle(record, settings, rows)
    if obstacle is not None:
        return obstacle
    assert not isinstance(settings, Unreadable)

    number, recorded = _last_evaluation(rows)
    control_steps = max(key.control_steps for key in recorded)
    try:
        changed = changed_code(record, results, accept_changed)
        if changed and isinstance(settings, RunSettings):
            settings = settings.model_copy(update={"accepted": "repeated"})
        agent = load_agent(results, record.id, accept_changed)
        device = device_here(record, at_end=True)
        with one_thread(), _acting(settings, agent, control_steps, device) as act:
            (evaluation,) = evaluate_policies(
                settings,
                [derive_seeds(settings.seed).evaluations],
                number,
                act,
                control_steps=control_steps,
                episodes=1 + max(key.episode for key in recorded),
                show_done=show_done,
            )
    except ChangedCodeError as error:
        return _not_comparable(record, str(error))
    except (RequestError, ValueError) as error:
        return _not_comparable(record, f"Its policy can't be run: {str(error).rstrip('.')}.")
    if evaluation.failure is not None:
        return _not_comparable(record, str(evaluation.failure))

    computed: Rows = {
        RowKey(control_steps, "evaluation", number, episode): {"episode_return": episode_return}
        for episode, episode_return in enumerate(evaluation.returns.tolist())
    }
    repeated = compared(record, control_steps, recorded, computed, "evaluation")
    if repeated.verdict == "different" and not is_installed(settings):
        here = fmean(repeated.computed)
        before = fmean(repeated.recorded)
        return _not_comparable(
            record,
            f"Without {settings.algo}, which is not installed, its saved layers act with other "
            f"rounding: their mean return is {here:.4g} here, and {before:.4g} was recorded.",
        )
    if not changed:
        return repeated

    reason = f"With changed code ({have_changed(changed)}). {repeated.reason}".rstrip()
    return repeated._replace(reason=reason)


def _acting(
    settings: RunSettings | ExternalSettings, agent: TrainedAgent, control_steps: int, device: str
) -> AbstractContextManager[Act]:
    """Returns a context with the actions of a kept policy; see `acting_as_evaluated`.

    If the algorithm is not installed, the saved layers act.
    """
    if is_installed(settings):
        return acting_as_evaluated(settings, agent, control_steps, device)
    return nullcontext(agent.act)


def _show_episode(progress: Callable[[int], None], event: Event) -> None:
    """Passes on the control step at which an episode ended."""
    if isinstance(event, EpisodeEnded):
        progress(event.control_steps)


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
    or its encoder is not at hand, and a WorkError if the run is damaged, or its training fails.
    """
    settings = _settings_to_train(results, record, accept_changed)
    until = steps_to_repeat(record, episodes)
    recorded = read_rows(record, "episode", "evaluation", until=until)
    computed = _train_again(results, record, settings, until, recorded, progress)
    if ENGINES[settings.engine].has_one_stream:
        recorded = without_early_final(recorded, record, settings.evaluate_episodes)

    repeated = compared(record, until, recorded, computed, "episode")
    losses = (row.get(name) for row in computed.values() for name in schema.LOSSES)
    if repeated.verdict == "equal" and all(loss is None for loss in losses):
        reason = "The agent was not updated in them; repeat more episodes."
        return repeated._replace(reason=reason)
    return repeated


def _settings_to_train(results: Results, record: Record, accept_changed: bool) -> RunSettings:
    """Returns the settings with which a run is trained again; raises as `retrain`."""
    settings = read_run(record.settings)
    if isinstance(settings, ExternalSettings):
        raise RequestError(
            f"{record.id} was trained by a loop that jbench does not have: only its evaluation "
            "can be repeated; type --episodes 0."
        )
    if not isinstance(settings, RunSettings):
        raise RequestError(
            f"Another program or version wrote the settings of {record.id}: repeat it there."
        )
    if not record.rows("episodes"):
        raise RequestError(
            f"{record.id} is {record.status} and has no episode to compare with; type the id of a "
            "run that has one."
        )
    weights.check_encoder(record, results)
    if not changed_code(record, results, accept_changed):
        return settings
    return settings.model_copy(update={"accepted": code_hash(run_code(settings, results))})


def _train_again(
    results: Results,
    record: Record,
    settings: RunSettings,
    until: int,
    recorded: Rows,
    progress: Callable[[int], None],
) -> Rows:
    """Trains a run up to a control step in a temporary directory, and returns its rows there.

    The evaluations are those of the recorded rows. Raises what ends the training.
    """
    evaluations = [key.number for key in recorded if key.kind == "evaluation"]
    with one_thread(), tempfile.TemporaryDirectory(prefix="jbench-") as directory:
        temporary = Results(Path(directory))
        failures = run_batch(
            [settings],
            temporary,
            encoders=results,
            device=device_here(record),
            until=until if until < settings.steps else None,
            final_episodes=evaluations.count(max(evaluations)) if evaluations else None,
            report=partial(_show_episode, progress),
        )
        for failure in failures.values():
            raise failure

        trained = temporary.find("run", settings.id)
        assert trained is not None
        return read_rows(trained, "episode", "evaluation", until=until)


def steps_to_repeat(record: Record, episodes: int) -> int:
    """Returns the control steps of a run until its first episodes have ended; 0 if none has."""
    ends = record.read("episodes")["control_steps"].to_pylist()
    return max(filter(None, ends[:episodes]), default=0)


def default_episodes(record: Record) -> int:
    """Returns how many episodes to train again: up to the first updates, and at least one."""
    rows = record.read("episodes")
    losses = np.column_stack([rows[name].is_valid().to_numpy() for name in schema.LOSSES])
    updated = np.flatnonzero(losses.any(axis=1))
    return int(updated[0]) + 1 if len(updated) else 1


def _last_evaluation(rows: Rows) -> tuple[int, Rows]:
    """Returns the number of the last evaluation of a run, and its rows."""
    number = max(key.number for key in rows)
    return number, {key: row for key, row in rows.items() if key.number == number}


def _obstacle(record: Record, settings: Run, rows: Rows) -> Repeated | None:
    """Returns why the kept policy can't be compared with the evaluations; None if it can."""
    if not has_policy(record):
        return Repeated(record.id, "no policy", "It was saved without its policy.")
    if isinstance(settings, Unreadable):
        return _not_comparable(record, "Another program or version wrote its settings.")
    if not rows:
        return _not_comparable(record, "It has no evaluation.")
    if recorded_device(record, at_end=True) != device_here(record, at_end=True):
        return _not_comparable(record, "A GPU evaluated it, and this machine has none.")
    if not ENGINES[settings.engine].copies_round_alike:
        return _not_comparable(
            record,
            "Its evaluations ran the agent's own code; the kept copy rounds sums differently.",
        )
    if not is_of_last_evaluation(record, settings, rows):
        return _not_comparable(
            record,
            "Its last evaluation was not made with the policy that was kept: with one before the "
            "last updates, as in older versions of jbench, or with a function of the caller.",
        )
    return None


def _not_comparable(record: Record, reason: str) -> Repeated:
    """Returns the outcome for a run that can't be compared, with the reason."""
    return Repeated(record.id, "not comparable", reason)
