"""When runs are evaluated whose user did not type it: as the recorded runs that they continue."""

from collections.abc import Mapping, Sequence
from typing import Any

from jbench.settings.evaluations import EVALUATION_EPISODES, evaluation_interval
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.continuation import continued_runs
from jbench.training.status import run_status


def with_kept_evaluations(
    runs: list[RunSettings], results: Results, typed: Mapping[str, Any]
) -> list[RunSettings]:
    """Returns runs with the evaluations of recorded ones that they are, or can continue.

    They are those of a run with the same settings whose evaluations are the defaults of older
    versions, or else those of a finished run that new ones continue. Evaluations are as typed if
    the user has typed how often they are.

    Args:
        typed: evaluate_every and evaluate_episodes, None if the user did not type them.
    """
    free = [name for name in ("evaluate_every", "evaluate_episodes") if typed[name] is None]
    if "evaluate_every" not in free:
        return runs
    if any(run_status(run, results).state != "missing" for run in runs):
        return runs
    older = [run.model_copy(update=_older_evaluations(run, free)) for run in runs]
    if older != runs and any(run_status(run, results).state != "missing" for run in older):
        return older

    for run in runs:
        for continued in continued_runs(run, results, *free):
            changes = {name: continued.settings[name] for name in free}
            return [each.model_copy(update=changes) for each in runs]
    return runs


def _older_evaluations(run: RunSettings, free: Sequence[str]) -> dict[str, int]:
    """Returns the default evaluations of versions in which a short run had those of a long one."""
    usual = {
        "evaluate_every": evaluation_interval(run.steps, run.episode_steps),
        "evaluate_episodes": EVALUATION_EPISODES,
    }
    return {name: usual[name] for name in free}
