"""Settings of runs that take a moment, and what such a run has come to."""

import importlib

from jbench.settings import run
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import schema
from jbench.store.merge import TIMES
from jbench.training import batched_run, engines, reproduce

EPISODE = 50


def shorten_episodes(set_attribute=setattr):
    """Makes the batched engine's episodes `EPISODE` control steps long."""
    # Each module knows their length by itself.
    rollout = importlib.import_module("jbench.simulation.rollout")  # the package has a function
    for module in (batched_run, engines, reproduce, rollout, run):
        set_attribute(module, "EPISODE_STEPS", EPISODE)


def small_run(algo, overrides, **changes):
    """Returns settings with networks of eight units.

    Args:
        algo: the algorithm.
        overrides: of its published settings.
        changes: of all others; the engine and the numbers of steps have no default.
    """
    overrides = {"hidden_layers": [8], **overrides}
    chosen = algorithm_settings(algo, overrides=overrides).model_dump(mode="json")
    about = {"task": "face_direction", "algo": algo, "seed": 0}
    return RunSettings(**{**about, "hyperparameters": chosen, **changes})


def rows(record):
    """Returns all rows of a run but their times."""
    return [
        {name: value for name, value in row.items() if name not in TIMES}
        for table, columns in (("episodes", schema.EPISODES), ("evaluations", schema.EVALUATIONS))
        for row in record.read(table, columns).to_pylist()
    ]
