"""Tests that a collected dataset depends only on its settings, not on threads or interruptions."""

from functools import partial

import pytest

from jbench.datasets import collect, fixed, plan_dataset
from jbench.errors import RequestError, WorkError
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.store import Results
from jbench.tasks.environment_worlds import EnvironmentWorlds
from jbench.tasks.find import find_task
from tests.short_episodes import shorten_episodes


def test_steps_are_whole_episodes(tmp_path):
    assert DatasetSettings().steps == 5_000_000
    sentence = "an episode has 1000 control steps; steps must be a multiple, such as 2000"
    settings = DatasetSettings(steps=1500)
    for work in (plan_dataset, partial(collect, threads=1)):
        with pytest.raises(RequestError, match=sentence):
            work(settings, Results(tmp_path))
    assert not any(tmp_path.iterdir())


def checksums(record):
    return {entry.name: entry.sha256 for entry in record.manifest.files}


def test_bytes_do_not_depend_on_threads_or_length(tmp_path, collect_in_files_of, monkeypatch):
    shorten_episodes(monkeypatch.setattr, 100)
    longer = collect_in_files_of(2, tmp_path / "longer", 600)
    for threads, files in ((1, 1), (3, 2)):
        shorter = collect_in_files_of(2, tmp_path / str(threads), files * 200, threads=threads)
        assert len(checksums(shorter)) == files * 2  # states and targets of two episodes
        assert checksums(shorter).items() < checksums(longer).items()
        assert shorter.rows("steps") == files * 2 * 101


def test_progress_is_reported_while_a_file_is_simulated(tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr, 100)
    monkeypatch.setattr(fixed, "REPORT_SECONDS", 0.001)
    seen = []
    collect(DatasetSettings(steps=2000), Results(tmp_path), 1, seen.append)
    assert (seen[0], seen[-1]) == (0, 2000)
    assert seen == sorted(seen)
    # A file has ten episodes of 100 control steps, and each of the two is reported on the way.
    assert any(0 < steps < 1000 for steps in seen)
    assert any(1000 < steps < 2000 for steps in seen)


def test_simulation_of_another_robot_stops_with_the_collection(tmp_path, monkeypatch):
    """Ctrl-C waits for a control step, not for the file, and then the environment is closed."""
    monkeypatch.setattr(fixed, "REPORT_SECONDS", 0.001)
    calls = []

    def noted(name):
        method = getattr(EnvironmentWorlds, name)

        def call(*arguments):
            calls.append(name)
            return method(*arguments)

        monkeypatch.setattr(EnvironmentWorlds, name, call)

    noted("step")
    noted("close")
    task = find_task("dmc:cartpole-swingup")
    settings = DatasetSettings(**dataset_robot(task.name, task.specs), steps=10_000)

    def interrupt(steps):
        if steps:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        collect(settings, Results(tmp_path), 1, interrupt)

    assert 0 < calls.count("step") < 10_000
    assert calls.index("close") == len(calls) - 1


def test_dataset_in_use_by_other_process_is_refused(tmp_path, collect_in_files_of):
    held = Results(tmp_path).folder("dataset", DatasetSettings(seed=3, steps=1000).id)
    with held.lock(), pytest.raises(WorkError, match="Another process is writing the dataset"):
        collect_in_files_of(1, tmp_path, 1000)
    assert {path.name for path in held.path.iterdir()} == {"lock"}
