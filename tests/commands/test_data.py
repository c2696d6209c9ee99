"""Tests of the commands on datasets: collect, datasets and export."""

import re
import shutil
import signal

import pytest

from jbench.datasets import Dataset, collect
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from tests.command_line import start, wait_until
from tests.short_episodes import short_episodes
from tests.store.store_rows import alter_manifest


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    """Makes the episodes in this process 100 control steps long."""
    with short_episodes(100):
        yield


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """A results directory with a plain dataset and an augmented one, which is newer."""
    path = tmp_path_factory.mktemp("collected") / "results"
    collect(DatasetSettings(steps=500), Results(path), 2)
    collect(DatasetSettings(steps=300, seed=4, augment=11), Results(path), 2)
    return path


@pytest.fixture
def results(tmp_path, collected):
    """A copy of that directory with a third, unfinished dataset."""
    shutil.copytree(collected, tmp_path / "results")
    settings = DatasetSettings(steps=9000, seed=7)
    Results(tmp_path / "results").create("dataset", settings.id, settings.model_dump())
    return tmp_path / "results"


def records(results):
    return {record.settings["seed"]: record for record in Results(results).scan("dataset")[0]}


def test_collect_stopped_by_ctrl_c_reports_that_it_can_resume(tmp_path):
    process = start("collect", "--steps", "500000", results=tmp_path)
    try:
        wait_until(lambda: any(tmp_path.rglob("manifest.json")), process)
        process.send_signal(signal.SIGINT)
        _, output = process.communicate(timeout=120)
    finally:
        process.kill()
    (dataset,) = Results(tmp_path).scan("dataset")[0]
    steps = dataset.rows("dataset_episodes") * 1000
    kept = f"{steps:,} of 500,000 control steps are kept; the same command continues there."
    nothing = "No control step is kept yet; the same command begins again."
    assert output.splitlines()[-1] == f"Stopped. {kept if steps else nothing}"
    assert process.returncode == 130
    assert [record.status for record in Results(tmp_path).scan("dataset")[0]] == ["unfinished"]


def test_steps_of_a_robot_that_may_fall_are_made_exactly(run_command, refused, tmp_path):
    falls = ("--task", "tests.gym_tasks:falls")
    code, out, err = run_command("collect", *falls, "--steps", 47, results=tmp_path)
    assert code == 0, err
    assert " 47 control steps" in out
    (dataset,) = map(Dataset, Results(tmp_path).scan("dataset")[0])
    (block,) = dataset.blocks(dataset.robot)
    assert block.lengths.tolist() == [7] * 6 + [5]  # it falls at its seventh control step
    assert block.terminated.tolist() == [True] * 6 + [False]

    code, out, err = run_command("collect", *falls, "--steps", 5, results=tmp_path / "single")
    assert code == 0, err
    sentence = refused("train-dae", *falls, "--latent", 2, results=tmp_path / "single")
    assert sentence.endswith("jbench collect --task tests.gym_tasks:falls --steps 200.\n")


def test_datasets_lists_all_with_settings_status_and_size(results, run_command, document):
    changed = {"wall_time": float("nan"), "seen": [float("inf")]}
    alter_manifest(records(results)[0], summary=changed)
    code, out, _ = run_command("datasets", results=results)
    assert code == 0
    lines = [line.split() for line in out.splitlines()]
    ids = {seed: record.id for seed, record in records(results).items()}
    assert " ".join(lines[0]) == f"3 datasets in {results}"
    rows = {line[0]: line[1:] for line in lines if line and line[0] in ids.values()}
    assert rows[ids[0]][:3] == ["finished", "500", "plain"]
    assert rows[ids[4]][:4] == ["finished", "300", "--augment", "11"]
    assert rows[ids[7]][:6] == ["unfinished", "0", "of", "9,000", "plain", "0.0"]
    output = document("datasets", results=results)
    assert output["problems"] == []
    listed = {entry["settings"]["seed"]: entry for entry in output["datasets"]}
    assert set(listed) == {0, 4, 7}
    for seed, record in records(results).items():
        size = sum(path.stat().st_size for path in record.path.glob("*.parquet"))
        assert listed[seed]["id"] == record.id
        assert listed[seed]["path"] == str(record.path)
        assert listed[seed]["settings"] == record.settings
        assert (listed[seed]["status"], listed[seed]["bytes"]) == (record.status, size)
    assert [listed[seed]["steps"] for seed in (0, 4, 7)] == [500, 300, 0]
    # JSON has no numbers that are not finite.
    assert listed[0]["summary"] == {"wall_time": None, "seen": [None]}


def test_unreadable_dataset_is_reported_and_others_listed(results, run_command):
    alter_manifest(records(results)[0], settings={"steps": "many"})
    code, out, err = run_command("datasets", results=results)
    assert (code, "2 datasets in" in out) == (1, True)
    assert re.search("Warning: .*can't be 'many'", err)
    assert "Error: 1 record is left out; see above." in err


def test_export_defaults_to_newest_plain_dataset(results, tmp_path, document):
    newest, other = (records(results)[seed].id for seed in (0, 4))
    for id, more in ((newest, ()), (other, ("--dataset", other, "--out", tmp_path / "out"))):
        output = document("export", "--task", "move_to_pose", *more, results=results)
        assert (output["dataset"], output["task"]) == (id, "move_to_pose")
        assert output["minari_id"] == f"jitterbug/move_to_pose/{id.replace('/', '-')}-v0"
        root = tmp_path / "out" if more else results / "minari"
        assert output["path"] == str(root / output["minari_id"])
        assert (root / output["minari_id"] / "data" / "metadata.json").exists()
