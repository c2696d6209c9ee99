"""Tests that collections interrupted by kills resume bit for bit."""

import json
from pathlib import Path

import pytest

from jbench.store import Results
from tests.command_line import Process


def checksums(record):
    return [(entry.name, entry.sha256, entry.rows) for entry in record.manifest.files]


def finished_dataset(path):
    (record,), problems = Results(path).scan("dataset")
    assert (record.status, problems) == ("finished", [])
    for entry in record.manifest.files:
        record.read_file(entry.name)
    listed = {entry.name for entry in record.manifest.files}
    assert {file.name for file in record.path.iterdir()} == {*listed, "manifest.json", "lock"}
    return record


@pytest.mark.parametrize("kills", [4, pytest.param(20, marks=pytest.mark.slow)])
def test_collection_killed_at_random_moments_resumes_bit_for_bit(tmp_path, kills):
    done = Process("tests.datasets.killed_collections:main", str(tmp_path), kills).finished()
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert len(printed["committed"]) >= kills
    assert len(set(printed["committed"])) > 3  # not all kills were before the first file
    uninterrupted, *killed = (finished_dataset(Path(path)) for path in printed["paths"])
    assert uninterrupted.rows("steps") == 30 * 21
    for record in killed:
        assert checksums(record) == checksums(uninterrupted)
