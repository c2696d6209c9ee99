"""Tests of the commands on datasets: collect, datasets and export."""

import json
import shutil
import signal
import subprocess

import pytest

from jbench.cli import main
from jbench.datasets import collect
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from tests.command_line import INTERRUPTIBLE, wait_until
from tests.store.store_rows import alter_manifest


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """A results directory with a plain dataset and an augmented one, which is newer."""
    path = tmp_path_factory.mktemp("collected") / "results"
    collect(DatasetSettings(steps=2000), Results(path), 2)
    collect(DatasetSettings(steps=1000, seed=4, augment=11), Results(path), 2)
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
    arguments = ["collect", "--steps", "500000", "--results", str(tmp_path)]
    with subprocess.Popen(
        [*INTERRUPTIBLE, *arguments], stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            wait_until(lambda: any(tmp_path.rglob("manifest.json")), process)
            process.send_signal(signal.SIGINT)
            _, output = process.communicate(timeout=120)
        finally:
            process.kill()
    assert output == "Stopped. The same command continues from the last commit, if any.\n"
    assert process.returncode == 1
    assert [record.status for record in Results(tmp_path).scan("dataset")[0]] == ["unfinished"]


def test_datasets_lists_all_with_status_and_steps(results, capsys):
    assert main(["datasets", "--results", str(results)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    ids = {seed: record.id for seed, record in records(results).items()}
    assert " ".join(lines[0]) == f"3 datasets in {results}"
    rows = {line[0]: line[1:] for line in lines if line and line[0] in ids.values()}
    assert rows[ids[0]][:3] == ["finished", "2,000", "plain"]
    assert rows[ids[4]][:4] == ["finished", "1,000", "--augment", "11"]
    assert rows[ids[7]][:6] == ["unfinished", "0", "of", "9,000", "plain", "0.0"]


def test_json_of_datasets_has_settings_status_and_size(results, capsys):
    assert main(["datasets", "--results", str(results), "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert output["problems"] == []
    listed = {entry["settings"]["seed"]: entry for entry in output["datasets"]}
    assert set(listed) == {0, 4, 7}
    for seed, record in records(results).items():
        size = sum(path.stat().st_size for path in record.path.glob("*.parquet"))
        assert listed[seed]["id"] == record.id
        assert listed[seed]["path"] == str(record.path)
        assert listed[seed]["settings"] == record.settings
        assert (listed[seed]["status"], listed[seed]["bytes"]) == (record.status, size)
    assert [listed[seed]["steps"] for seed in (0, 4, 7)] == [2000, 1000, 0]


def test_json_of_summary_that_is_not_finite_has_null(results, capsys):
    alter_manifest(records(results)[0], summary={"wall_time": float("nan"), "seen": [float("inf")]})
    assert main(["datasets", "--results", str(results), "--json"]) == 0
    summaries = [entry["summary"] for entry in json.loads(capsys.readouterr().out)["datasets"]]
    assert {"wall_time": None, "seen": [None]} in summaries


def test_empty_directory_reports_command_to_type(tmp_path, capsys):
    assert main(["datasets", "--results", str(tmp_path)]) == 0
    command = f"jbench collect --steps 100000 --results {tmp_path}"
    output = f"No datasets in {tmp_path}; {command} makes a small one.\n"
    assert capsys.readouterr().out == output


def test_unreadable_dataset_is_reported_and_others_listed(results, capsys):
    alter_manifest(records(results)[0], settings={"steps": "many"})
    assert main(["datasets", "--results", str(results), "--json"]) == 1
    printed = capsys.readouterr()
    listed = json.loads(printed.out)
    assert {entry["settings"]["seed"] for entry in listed["datasets"]} == {4, 7}
    (problem,) = listed["problems"]
    assert "can't be 'many'" in problem
    assert f"Warning: {problem}" in printed.err
    assert "Error: 1 record is damaged and left out; see above." in printed.err


def test_export_defaults_to_newest_plain_dataset(results, tmp_path, capsys):
    newest, other = (records(results)[seed].id for seed in (0, 4))
    command = ["export", "--task", "move_to_pose", "--results", str(results), "--json"]
    for id, more in ((newest, ()), (other, ("--dataset", other, "--out", str(tmp_path / "out")))):
        assert main([*command, *more]) == 0
        output = json.loads(capsys.readouterr().out)
        assert (output["dataset"], output["task"]) == (id, "move_to_pose")
        assert output["minari_id"] == f"jitterbug/move_to_pose/{id.replace('/', '-')}-v0"
        root = tmp_path / "out" if more else results / "minari"
        assert output["path"] == str(root / output["minari_id"])
        assert (root / output["minari_id"] / "data" / "metadata.json").exists()
