"""Settings of runs that take a moment, and what such a run has come to."""

from jbench.agents.settings import algorithm_settings
from jbench.experiments.settings import RunSettings
from jbench.store import schema


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
        {name: value for name, value in row.items() if name != "wall_time"}
        for table, columns in (("episodes", schema.EPISODES), ("evaluations", schema.EVALUATIONS))
        for row in record.read(table, columns).to_pylist()
    ]
