"""Tests that collections interrupted by kills or a full disk resume bit for bit."""

import importlib
import json
from pathlib import Path

import pytest

from jbench.datasets import collect
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from tests.command_line import Process

SETTINGS = DatasetSettings(seed=3, steps=2000)


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


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        collecting = importlib.import_module("jbench.datasets.collect")
        patch.setattr(collecting, "_PART_EPISODES", 1)
        patch.setattr(collecting, "EPISODE_STEPS", 100)
        return collect(SETTINGS, Results(tmp_path_factory.mktemp("uninterrupted")), 2)


@pytest.mark.parametrize("kills", [8, pytest.param(20, marks=pytest.mark.slow)])
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


def error_line(text):
    """The only line that is not progress."""
    (line,) = [line for line in text.splitlines() if not line.startswith("collect: ")]
    return line


def test_collection_resumes_after_a_file_size_limit(tmp_path, uninterrupted):
    stopped = Process("tests.datasets.limited:collect", 10_000, str(tmp_path)).finished()
    assert stopped.returncode == 1
    printed = error_line(stopped.stderr)
    assert printed.startswith("Error: No room left to write steps-00000-")
    assert printed.endswith(
        "what was finished is kept: free some space and type the command again."
    )
    assert Results(tmp_path).find("dataset", SETTINGS.id).status == "unfinished"
    again = Process("tests.datasets.limited:collect", -1, str(tmp_path)).finished()
    assert again.returncode == 0, again.stderr
    assert checksums(finished_dataset(tmp_path)) == checksums(uninterrupted)
