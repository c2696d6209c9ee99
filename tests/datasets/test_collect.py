"""Tests that a collected dataset depends only on its settings, not on threads or interruptions."""

import hashlib
import importlib
import tracemalloc

import pyarrow
import pytest
from pydantic import ValidationError

from jbench.datasets import collect
from jbench.errors import WorkError
from jbench.settings.records import DatasetSettings
from jbench.store import Results


class Stopped(BaseException):
    """Stops a collection, like Ctrl-C."""


@pytest.fixture
def short_episodes(shorten_datasets, monkeypatch):
    """Makes episodes 100 control steps long."""
    shorten_datasets(monkeypatch.setattr, 100)


def checksums(record):
    """The SHA-256 of each file that the manifest lists."""
    return {
        entry.name: hashlib.sha256((record.path / entry.name).read_bytes()).hexdigest()
        for entry in record.manifest.files
    }


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"steps": 1500}, "steps must be a multiple, such as 2000"),
        ({"steps": 0}, "greater than 0"),
        ({"step": 1000}, "Extra inputs are not permitted"),
    ],
)
def test_invalid_settings_are_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        DatasetSettings(**settings)


def test_default_settings_equal_paper_and_are_frozen():
    settings = DatasetSettings()
    assert (settings.steps, settings.policy, settings.seed) == (5_000_000, "random", 0)
    with pytest.raises(ValidationError, match="frozen"):
        settings.steps = 1000


@pytest.mark.usefixtures("short_episodes")
def test_bytes_do_not_depend_on_threads_or_length(tmp_path, collect_in_files_of):
    longer = collect_in_files_of(2, tmp_path / "longer", 600)
    for threads, files in ((1, 1), (3, 2)):
        shorter = collect_in_files_of(2, tmp_path / str(threads), files * 200, threads=threads)
        assert len(checksums(shorter)) == files * 2  # states and targets of two episodes
        assert checksums(shorter).items() < checksums(longer).items()
        assert shorter.rows("steps") == files * 2 * 101


# `test_interruptions.py` compares collections that were killed with one that was not.
@pytest.mark.usefixtures("short_episodes")
def test_stopped_collection_resumes_with_next_file(tmp_path, collect_in_files_of):
    def stop(steps):
        if steps == 200:
            raise Stopped

    with pytest.raises(Stopped):
        collect_in_files_of(1, tmp_path / "stopped", 400, progress=stop)
    id = DatasetSettings(seed=3, steps=400).id
    left = Results(tmp_path / "stopped").find("dataset", id)
    assert left.status == "unfinished"
    assert left.rows("dataset_episodes") == 2
    (left.path / "steps-00099-0badc0de.parquet").write_bytes(b"half")

    seen = []
    again = collect_in_files_of(1, tmp_path / "stopped", 400, progress=seen.append)
    assert seen[0] == 200  # resumed, not restarted
    assert seen[-1] == 400
    assert checksums(left).items() < checksums(again).items()
    assert {path.name for path in again.path.iterdir()} == {
        *("manifest.json", "lock"),
        *checksums(again),
    }


@pytest.mark.slow
def test_memory_does_not_grow_with_number_of_files(tmp_path, shorten_datasets, monkeypatch):
    collecting = importlib.import_module("jbench.datasets.collect")
    monkeypatch.setattr(collecting, "_PART_EPISODES", 1)
    shorten_datasets(monkeypatch.setattr, 250)
    peaks, held = [], []
    for episodes in (2, 4, 16):  # the first for one-time allocations
        settings = DatasetSettings(seed=3, steps=250 * episodes)
        tracemalloc.start()
        collect(settings, Results(tmp_path), 2)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        held.append(pyarrow.total_allocated_bytes())
    # Twelve more trajectories would be 0.75 MB, their rows another 0.25 MB. The number in memory at
    # a time depends on the threads.
    assert peaks[2] < peaks[1] + 350_000
    assert held[2] < held[1] + 50_000


def test_finished_dataset_is_returned_unchanged(six_episodes, collect_in_files_of):
    def state():
        found = {path.name: path.stat() for path in six_episodes.path.iterdir()}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found.items()}

    before, seen = state(), []
    again = collect_in_files_of(2, six_episodes.path.parents[2], 6000, progress=seen.append)
    assert state() == before
    assert (again.id, again.status, seen) == (six_episodes.id, "finished", [])


def test_dataset_in_use_by_other_process_is_refused(tmp_path, collect_in_files_of):
    held = Results(tmp_path).record("dataset", DatasetSettings(seed=3, steps=1000).id)
    with held.lock(), pytest.raises(WorkError, match="Another process is writing the dataset"):
        collect_in_files_of(1, tmp_path, 1000)
    assert {path.name for path in held.path.iterdir()} == {"lock"}
