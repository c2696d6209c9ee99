"""Settings of short runs, and readers of their rows."""

import importlib
import itertools
from collections import Counter

from gymnasium.envs.registration import registry

from jbench.names import TASKS
from jbench.policies import evaluate
from jbench.recording import request
from jbench.registration import environment_id, register_environments
from jbench.settings import run
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store.merge import TIMES
from jbench.training import engines, log, repeat, status
from jbench.training.batched_run import run_batch

EPISODE = 50


def shorten_episodes(set_attribute=setattr, steps=EPISODE):
    """Makes the episodes of training, of evaluations and of Gymnasium's environments shorter.

    Args:
        set_attribute: for example that of pytest's `monkeypatch`, which reverts it.
        steps: control steps per episode.
    """
    # Each module has its own constant for the length.
    rollout = importlib.import_module("jbench.simulation.rollout")  # the package exports a function
    for module in (engines, evaluate, log, repeat, request, rollout, run, status):
        set_attribute(module, "EPISODE_STEPS", steps)
    register_environments()
    for task, augmented in itertools.product(TASKS, (False, True)):
        set_attribute(registry[environment_id(task, augmented)], "max_episode_steps", steps)


def small_run(algo, overrides, **changes):
    """Returns settings with networks of eight units.

    Args:
        algo: the algorithm.
        overrides: changes of its published settings.
        changes: other settings of the run; the engine and the numbers of steps have no default.
    """
    overrides = {"hidden_layers": [8], **overrides}
    chosen = algorithm_settings(algo, overrides=overrides).model_dump(mode="json")
    about = {"task": "face_direction", "algo": algo, "seed": 0}
    return RunSettings(**{**about, "hyperparameters": chosen, **changes})


def train(run, results, **options):
    """Trains a run; returns its record, or raises the error of the run."""
    for failure in run_batch([run], results, **options).values():
        raise failure
    return results.find("run", run.id)


def paths(record):
    """Returns the number of rows of each path by evaluation and control steps."""
    found = record.read("paths").to_pylist()
    return dict(Counter((row["evaluation"], row["control_steps"]) for row in found))


def resumed(events, runs):
    """Returns seed, control steps and reason of resumed runs, and the id of one they continue."""
    seeds = {run.id: run.seed for run in runs}
    return [
        (seeds[event.run], event.steps, event.text, *filter(None, [event.continues]))
        for event in events
        if event.kind == "resumed"
    ]


def rows(record):
    """Returns all rows of a run, without times."""
    return [
        {name: value for name, value in row.items() if name not in TIMES}
        for table in ("episodes", "evaluations")
        for row in record.read(table).to_pylist()
    ]
