"""Completion of values by the shell; typer leaves out those without the typed beginning."""

import importlib.metadata
from glob import escape, glob
from pathlib import Path

import typer

from jbench import names, task_specs


def complete_tasks() -> list[str]:
    """Offers the Jitterbug's tasks, installed ones, and those of dm_control's suite."""
    points = importlib.metadata.entry_points(group=task_specs.TASK_GROUP)
    return [*names.TASKS, *sorted(point.name for point in points), *task_specs.SUITE_TASKS]


def complete_datasets(context: typer.Context) -> list[str]:
    """Offers the datasets of --results."""
    return _ids(context, "dataset")


def complete_policies(context: typer.Context) -> list[str]:
    """Offers hand-written policies, runs of --results, and shipped policies."""
    shipped = [f"{names.REFERENCE}/{id}" for id in _ids(names.REFERENCE, "run", "policy*.json")]
    return [names.HEURISTIC, "random", "constant:1", *shipped, *_ids(context, "run")]


def complete_encoders(context: typer.Context, incomplete: str) -> list[str]:
    """Offers the representations of the encoders in --results, and their ids after a slash."""
    ids = _ids(context, "encoder")
    representations = sorted({id.split("/")[1] for id in ids if id.count("/") > 1})
    return ids if "/" in incomplete else ["none", *representations]


def complete_results(incomplete: str) -> list[str]:
    """Offers the shipped results and directories."""
    directories = (name for name in glob(f"{escape(incomplete)}*") if Path(name).is_dir())
    return [names.REFERENCE, *sorted(directories)]


def complete_settings(context: typer.Context) -> list[str]:
    """Offers the hyperparameters of the typed algorithm of jbench."""
    from jbench.settings.algorithms import SETTINGS

    settings = SETTINGS.get(context.params.get("algo") or "ddpg")
    return [f"{name}=" for name in getattr(settings, "model_fields", ())]


def _ids(where: typer.Context | str, kind: str, file: str = "manifest.json") -> list[str]:
    """Returns the ids of records with a file in a directory, or in --results; it need not exist."""
    typed = where if isinstance(where, str) else where.params.get("results") or names.RESULTS
    results = Path(typed)
    if names.is_reference(results):
        results = Path(__file__).parents[1] / names.REFERENCE
    root = results / f"{kind}s"
    return sorted(path.parent.relative_to(root).as_posix() for path in root.rglob(file))
