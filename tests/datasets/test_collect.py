"""A dataset is the same bytes for the same seed, whatever the threads and the interruptions."""

import hashlib
import importlib
import json
import signal
import subprocess
import sys
import tracemalloc

import pyarrow
import pytest
from pydantic import ValidationError

from jbench.datasets import collect
from jbench.errors import WorkError
from jbench.settings import dataset
from jbench.settings.dataset import DatasetSettings
from jbench.store import Results

# One episode to a file; a line is printed as each is committed.
COLLECTING = """
import importlib, sys
from pathlib import Path
from jbench.datasets import collect
from jbench.settings.dataset import DatasetSettings
from jbench.store import Results
importlib.import_module("jbench.datasets.collect")._PART_EPISODES = 1
progress = lambda steps: print(steps, flush=True)
collect(DatasetSettings(seed=3, steps=4000), Results(Path(sys.argv[1])), 1, progress)
"""


def checksums(record):
    """The SHA-256 of what lies on the disk, by the manifest's names."""
    return {
        entry.name: hashlib.sha256((record.path / entry.name).read_bytes()).hexdigest()
        for entry in record.manifest.files
    }


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"steps": 1500}, "steps must be a multiple, such as 2000"),
        ({"steps": 1}, "such as 1000"),
        ({"steps": 0}, "greater than 0"),
        ({"steps": -1000}, "greater than 0"),
        ({"steps": 1000.5}, "integer"),
        ({"seed": -1}, "greater than or equal to 0"),
        ({"step": 1000}, "Extra inputs are not permitted"),
    ],
)
def test_invalid_settings_are_refused(settings, said):
    with pytest.raises(ValidationError, match=said):
        DatasetSettings(**settings)


def test_settings_are_the_papers_by_default_and_cannot_be_changed():
    settings = DatasetSettings()
    assert (settings.steps, settings.policy, settings.seed) == (5_000_000, "random", 0)
    with pytest.raises(ValidationError, match="frozen"):
        settings.steps = 1000


def test_id_is_made_of_the_settings():
    text = json.dumps({"policy": "random", "robot": "jitterbug", "seed": 7, "steps": 2000})
    digest = hashlib.sha256(text.replace(" ", "").encode()).hexdigest()
    assert DatasetSettings(seed=7, steps=2000).id == f"random/s07-{digest[:8]}"


def test_bytes_do_not_depend_on_threads_or_length(tmp_path, six_episodes, collect_in_files_of):
    for threads, files in ((1, 1), (3, 2)):
        steps = files * 2000
        shorter = collect_in_files_of(2, tmp_path / str(threads), steps, threads=threads)
        assert len(checksums(shorter)) == files * 2  # states and targets of two episodes
        assert checksums(shorter).items() < checksums(six_episodes).items()
        assert shorter.rows("steps") == files * 2 * 1001


def test_killed_collection_resumes_to_the_same_bytes(tmp_path, collect_in_files_of):
    command = [sys.executable, "-c", COLLECTING, str(tmp_path / "killed")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        for steps in process.stdout:
            if int(steps) == 2000:
                break
        process.send_signal(signal.SIGKILL)
    id = DatasetSettings(seed=3, steps=4000).id
    left = Results(tmp_path / "killed").find("dataset", id)
    assert process.returncode == -signal.SIGKILL
    assert left.status == "unfinished"
    committed = left.rows("dataset_episodes")
    assert 2 <= committed < 4
    (left.path / "steps-00099-0badc0de.parquet").write_bytes(b"half")

    seen = []
    again = collect_in_files_of(1, tmp_path / "killed", 4000, progress=seen.append)
    assert seen[0] == 1000 * committed  # it went on, and did not start over
    assert seen[-1] == 4000
    assert checksums(left).items() < checksums(again).items()
    whole = collect_in_files_of(1, tmp_path / "whole", 4000)
    assert checksums(again) == checksums(whole)
    assert {path.name for path in again.path.iterdir()} == {
        "manifest.json",
        "lock",
        *checksums(whole),
    }


def test_memory_is_the_same_for_four_times_as_many_files(tmp_path, monkeypatch):
    collecting = importlib.import_module("jbench.datasets.collect")
    monkeypatch.setattr(collecting, "_PART_EPISODES", 1)
    for module in (collecting, dataset):
        monkeypatch.setattr(module, "EPISODE_STEPS", 500)
    peaks, held = [], []
    for episodes in (2, 4, 16):  # the first for what is made once
        settings = DatasetSettings(seed=3, steps=500 * episodes)
        tracemalloc.start()
        collect(settings, Results(tmp_path), 2)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        held.append(pyarrow.total_allocated_bytes())
    # Twelve more trajectories are 1.5 MB, their rows another 0.5; how many are there at a time
    # depends on the threads.
    assert peaks[2] < peaks[1] + 700_000
    assert held[2] < held[1] + 100_000


def test_finished_dataset_is_returned_untouched(six_episodes, collect_in_files_of):
    def state():
        found = {path.name: path.stat() for path in six_episodes.path.iterdir()}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found.items()}

    before, seen = state(), []
    again = collect_in_files_of(2, six_episodes.path.parents[2], 6000, progress=seen.append)
    assert state() == before
    assert (again.id, again.status, seen) == (six_episodes.id, "finished", [])


def test_two_processes_do_not_collect_the_same_dataset(tmp_path, collect_in_files_of):
    held = Results(tmp_path).record("dataset", DatasetSettings(seed=3, steps=1000).id)
    with held.lock(), pytest.raises(WorkError, match="Another process is writing the dataset"):
        collect_in_files_of(1, tmp_path, 1000)
    assert {path.name for path in held.path.iterdir()} == {"lock"}
