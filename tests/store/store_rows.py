"""Rows, records and manifests to test the store with."""

import json

import pyarrow as pa

from jbench.store import schema
from jbench.store.files import sha256

ROWS = pa.schema([("n", pa.int64())])
"""The columns of the tables in these tests."""

RUN_SETTINGS = {
    "task": "face_direction",
    "algo": "ddpg",
    "representation": "full",
    "encoder": None,
    "seed": 0,
    "steps": 3000,
    "engine": "sb3",
    "time_limit": "bootstrap",
}


def numbers(*values):
    return pa.table({"n": pa.array(values, pa.int64())}, schema=ROWS)


def read(record, table="t"):
    """The committed numbers of a table."""
    return record.read(table, ROWS)["n"].to_pylist()


def manifest_of(record):
    return json.loads((record.path / "manifest.json").read_text())


def alter_manifest(record, **changes):
    """Overwrites fields of the manifest on the disk."""
    changed = {**manifest_of(record), **changes}
    (record.path / "manifest.json").write_text(json.dumps(changed))


def put_in_place(record, content, **entry):
    """Overwrites the first file, with its size and checksum in the manifest."""
    first, *rest = manifest_of(record)["files"]
    (record.path / first["name"]).write_bytes(content)
    changed = {**first, "bytes": len(content), "sha256": sha256(content), **entry}
    alter_manifest(record, files=[changed, *rest])


def listed(record):
    """The names of the files that the manifest on the disk lists."""
    return [entry["name"] for entry in manifest_of(record)["files"]]


def names(directory):
    return {path.name for path in directory.iterdir()}


def episodes(run, returns):
    """Rows of the table `episodes`: 1000 steps and 2 s each, no losses."""
    rows = [
        {
            "run": run,
            "episode": episode,
            "control_steps": 1000 * (episode + 1),
            "episode_return": episode_return,
            "length": 1000,
            "wall_time": 2.0 * (episode + 1),
        }
        for episode, episode_return in enumerate(returns)
    ]
    return pa.Table.from_pylist(rows, schema.EPISODES)


def add_run(results, id, returns=(), **settings):
    record = results.create("run", id, {**RUN_SETTINGS, **settings})
    record.append({"episodes": episodes(id, returns)})
    return record
