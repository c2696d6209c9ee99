"""Tests of the export to Minari, whose reader must load the observations of the dataset."""

import json
import shutil
import sys

import minari
import numpy as np
import pytest
from dm_control import suite

from jbench.cli import main
from jbench.datasets import Dataset, collect, find_dataset
from jbench.datasets.export import export_minari
from jbench.datasets.observations import EPISODE_COLUMNS
from jbench.errors import RequestError, WorkError
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.store import Results
from jbench.tasks.find import find_task
from tests.command_line import Process


@pytest.fixture
def root(tmp_path, monkeypatch):
    """An empty directory that Minari searches for datasets."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    return tmp_path / "minari"


@pytest.fixture
def copied(tmp_path, six_episodes):
    """A copy of the results with the six episodes, which tests may damage."""
    shutil.copytree(six_episodes.path.parents[2], tmp_path / "results")
    return tmp_path / "results"


def files(path):
    return {file: file.read_bytes() for file in path.rglob("*") if file.is_file()}


@pytest.mark.parametrize("task", TASKS)
def test_minari_loads_observations_and_rewards_of_task(task, dataset, root):
    seen = []
    id, size = export_minari(dataset, task, root, seen.append)
    assert seen == [2, 4, 6]
    assert id == f"jitterbug/{task}/random-{dataset.id[-12:]}-v0"
    loaded = minari.load_dataset(id)
    assert (loaded.id, loaded.total_episodes, loaded.total_steps) == (id, 6, 6000)
    expected = [np.concatenate(parts) for parts in zip(*dataset.blocks(task), strict=True)][:3]
    for number, episode in enumerate(loaded):
        assert episode.id == number
        found = episode.observations, episode.actions[:, 0], episode.rewards
        for ours, theirs in zip(expected, found, strict=True):
            assert theirs.dtype == np.float32
            np.testing.assert_array_equal(ours[number], theirs)
        assert not episode.terminations.any()
        np.testing.assert_array_equal(np.flatnonzero(episode.truncations), [999])
    env = loaded.recover_environment()
    assert env.spec.id == environment_id(task)
    assert env.observation_space == loaded.observation_space
    assert env.action_space == loaded.action_space
    assert size == sum(len(content) for content in files(root / id).values())


def test_recovered_environment_has_augmented_robot(tmp_path, root):
    record = collect(DatasetSettings(steps=1000, augment=11), Results(tmp_path / "results"), 1)
    id, _ = export_minari(Dataset(record), "face_direction", root)
    loaded = minari.load_dataset(id)
    env = loaded.recover_environment()
    assert env.spec.kwargs["augment"] == 11
    export_minari(Dataset(record), "move_to_pose", root)
    import gymnasium

    # The registered environment is unchanged.
    assert gymnasium.spec("AugmentedJitterbug/FaceDirection-v0").kwargs["augment"] == 0


def test_dataset_of_another_robot_is_exported_with_its_own_task(tmp_path, root, refused, capsys):
    task, results = "dmc:cheetah-run", Results(tmp_path / "results")
    about = find_task(task)
    robot = dataset_robot(about.name, about.specs)
    record = collect(DatasetSettings(steps=2000, **robot), results, 1)
    typed = ("export", "--dataset", record.id, "--out", root)
    error = refused(*typed, "--task", "face_direction", results=results.path)
    assert f"The dataset {record.id} is of {task}, not of face_direction" in error
    assert not root.exists()
    assert main([*map(str, typed), "--results", str(results.path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["task"] == task
    assert printed["minari_id"] == f"jbench/dmc-cheetah-run/random-{record.id[-12:]}-v0"
    loaded = minari.load_dataset(printed["minari_id"])
    assert (loaded.total_episodes, loaded.total_steps) == (2, 2000)
    seeds = record.read("seeds", EPISODE_COLUMNS)["seed"].to_pylist()
    for episode, seed in zip(loaded, seeds, strict=True):
        # dm_control's own episode of this seed with these actions.
        theirs = suite.load("cheetah", "run", task_kwargs={"random": seed})
        steps = [theirs.reset(), *map(theirs.step, episode.actions)]
        observations = [np.concatenate([*step.observation.values()]) for step in steps]
        np.testing.assert_array_equal(episode.observations, np.float32(observations))
        np.testing.assert_array_equal(
            episode.rewards, np.float32([step.reward for step in steps[1:]])
        )
        np.testing.assert_array_equal(np.flatnonzero(episode.truncations), [999])
    env = loaded.recover_environment()
    assert env.spec.id == environment_id(task)
    assert env.observation_space == loaded.observation_space
    assert env.action_space == loaded.action_space


def test_killed_export_is_repeated_and_finished_one_not_overwritten(dataset, root):
    path = root / dataset.layout.minari_id(dataset.id, "face_direction")
    left = path.with_name(f".writing-{path.name}") / "data"
    left.mkdir(parents=True)
    (left / "metadata.json").write_text("{}")
    assert root / export_minari(dataset, "face_direction", root)[0] == path
    assert len(minari.load_dataset(path.relative_to(root).as_posix())) == 6
    before = files(root)
    # As after an export that could not remove its temporary directory.
    left.mkdir(parents=True)
    (left.parent / "lock").touch()
    with pytest.raises(RequestError, match="exists already and is not overwritten; name another"):
        export_minari(dataset, "face_direction", root)
    assert files(root) == before
    assert not left.parent.exists()


def test_export_of_damaged_dataset_leaves_no_files(copied, root):
    damaged = find_dataset(Results(copied))
    part = damaged.record.path / damaged.record.parts("steps")[2].name
    part.write_bytes(part.read_bytes()[:-1])
    with pytest.raises(WorkError, match=f"{damaged.id}/{part.name} is damaged"):
        export_minari(damaged, "face_direction", root)
    assert files(root) == {}
    assert minari.list_local_datasets() == {}


def test_full_disk_is_reported_and_leaves_no_files(copied, tmp_path):
    arguments = ("export", "--results", str(copied), "--out", str(tmp_path / "out"))
    done = Process("tests.store.store_faults:run_limited", 100_000, *arguments).finished()
    assert done.returncode == 1
    assert done.stderr.startswith(f"Error: {tmp_path / 'out'}")
    # 6 episodes of 1001 rows of 74 bytes, and half of that for the format.
    assert done.stderr.endswith("can't be written (File too large); it needs 0.7 MB of space.\n")
    assert done.stderr.count("\n") == 1
    assert files(tmp_path / "out") == {}


@pytest.mark.parametrize("module", ["minari", "h5py"])
def test_missing_minari_error_names_package(module, copied, tmp_path, monkeypatch, capsys):
    # A module that is None can't be imported, as if it were not installed.
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["export", "--results", str(copied), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == (
        f"Error: Exporting needs {module}, which is not installed: type pip install "
        "'jbench[minari]'.\n"
    )
    assert not (tmp_path / "out").exists()
