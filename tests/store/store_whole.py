"""Builds valid records whose ids are derived from their settings."""

import pyarrow as pa

from jbench.settings.base import settings_hash
from jbench.store import Record, schema
from jbench.store.manifest import Manifest
from tests.store.store_rows import RUN_SETTINGS, episodes


def add(results, kind, name, settings, tables=None, files=None, finish=True):
    id = f"{name}/s{settings['seed']:02d}-{settings_hash(settings)}"
    record = results.create(kind, id, settings)
    record.append({name: rows(id) for name, rows in (tables or {}).items()})
    if finish:
        record.finish({"wall_time": 7.5}, files or {})
    return record


def add_whole_run(results, returns=(10.0, 20.0, 60.0), finish=True, **settings):
    values = {**RUN_SETTINGS, **settings}
    name = f"{values['task']}/{values['algo']}/{values['representation']}"
    tables = {"episodes": lambda id: episodes(id, returns)}
    return add(results, "run", name, values, tables, {"policy.json": b"{}"}, finish)


def restart(run):
    """Starts an unfinished run over; only the time of creation tells the two apart."""
    created = run.manifest.created
    while run.manifest.created == created:
        Record.begin(run.folder, Manifest.new(run.kind, run.id, run.settings, {}))
        run.refresh()


def add_chain(results):
    """A dataset, an encoder trained on it, a run with the encoder and an evaluation of the run."""
    steps = {
        "steps": lambda id: pa.Table.from_pylist(
            [{"episode": 0, "step": step} for step in range(1001)], schema.STEPS
        ),
        "dataset_episodes": lambda id: pa.Table.from_pylist(
            [{"episode": 0}], schema.DATASET_EPISODES
        ),
    }
    dataset = add(results, "dataset", "random", {"seed": 0, "steps": 1000}, steps)
    settings = {"kind": "dae", "latents": 12, "seed": 0, "dataset": dataset.id}
    encoder = add(results, "encoder", "face_direction/dae12", settings, {}, {"encoder.json": b"{}"})
    run = add_whole_run(results, representation="dae12", encoder=encoder.id)
    settings = {"task": "face_direction", "policy": run.id, "seed": 0}
    evaluation = add(results, "evaluation", "face_direction/policy", settings)
    return dataset, encoder, run, evaluation


def snapshot(directory):
    """The files below a directory: path to content."""
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in directory.rglob("*")
        if path.is_file() and not path.is_symlink()
    }
