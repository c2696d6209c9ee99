"""Tests that a killed command (SIGKILL) leaves a readable database and resumes when repeated.

Episodes are short.
"""

import json
from functools import partial

import pytest

from jbench.store import Results, locks
from jbench.store.query import load
from tests import command_line
from tests.command_line import SHORT, kill_when, train, wait_until

jbench = partial(command_line.jbench, short=True)
start = partial(command_line.start, short=True)
succeed = partial(command_line.succeed, short=True)


def test_killed_collection_is_readable_and_resumes(tmp_path):
    # The dataset has one file, written seconds after the manifest.
    steps = ("collect", "--steps", "2000")
    kill_when(lambda: any(tmp_path.rglob("manifest.json")), start(*steps, results=tmp_path))
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("unfinished", 0)
    refused = jbench("train-dae", results=tmp_path)
    assert refused.returncode == 2
    assert "No finished dataset" in refused.stderr
    succeed(*steps, results=tmp_path)
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("finished", 2000)
    # Unlisted files that the kill left are removed: the manifest lists every file.
    listed = {
        entry.name for entry in Results(tmp_path).find("dataset", row["dataset"]).parts("steps")
    }
    assert {path.name for path in tmp_path.rglob("steps-*.parquet")} == listed


def wait_until_free(record):
    """Waits until the worker, which ends with its parent, has released the lock."""
    wait_until(lambda: not locks.is_held(record.path))


def test_killed_training_is_readable_and_resumes(tmp_path):
    arguments = train("td3", "none", "--steps", "1500", "--jobs", "1")
    checkpoints = (*arguments, "--checkpoint-every", "0")
    process = start(*checkpoints, results=tmp_path)
    kill_when(lambda: len(list(tmp_path.rglob("checkpoint-*"))) >= 3, process)
    results = Results(tmp_path)
    found = results.scan("run")[0]
    for record in found:
        assert record.status == "unfinished"
        assert set(record.read("episodes")["length"].to_pylist()) <= {SHORT}
        wait_until_free(record)
    done = succeed(*arguments, results=tmp_path)
    for record in found:
        assert f"{record.id} was interrupted or failed; it resumes at control step" in done.stdout
        ended = results.find("run", record.id)
        assert ended.status == "finished"
        assert ended.rows("episodes") == 15
        (continued,) = ended.manifest.provenance["continued"]
        assert continued["control_steps"] >= SHORT
        assert continued["changed"] == {}
    assert not list(tmp_path.rglob("checkpoint-*"))


@pytest.mark.slow
def test_longer_run_continues_or_says_why_it_begins(tmp_path):
    arguments = train("ddpg", "none", "--seeds", "0-1", "--jobs", "1", "--evaluate-episodes", "0")
    succeed(*arguments, "--steps", "300", results=tmp_path)
    done = succeed(*arguments, "--steps", "400", "--keep-state", results=tmp_path)
    assert (
        "2 runs train from the beginning, not from the end of finished runs of 300 control steps: "
        "the state was not kept, as --keep-state does.\n"
    ) in done.stdout
    done = succeed(*arguments, "--steps", "600", results=tmp_path)
    assert done.stdout.startswith("2 runs with 400 control steps left ")
    for record in Results(tmp_path).scan("run")[0]:
        assert bool(record.roles()) == (record.settings["steps"] == 400)
        if record.settings["steps"] == 600:
            (continued,) = record.manifest.provenance["continued"]
            assert (
                f"The run {record.id} continues {continued['run']} from control step 400.\n"
            ) in done.stdout
            assert record.rows("episodes") == 6
    succeed("verify", results=tmp_path)
    refused = jbench(*arguments, "--engine", "sb3", "--keep-state", results=tmp_path)
    assert refused.returncode == 2
    assert "stable-baselines3 has no checkpoints here; leave --keep-state out" in refused.stderr


@pytest.mark.slow
def test_killed_run_of_stable_baselines3_restarts_with_notice(tmp_path):
    arguments = train("td3", "none", "--steps", "1000", "--seeds", "0", "--engine", "sb3")
    kill_when(lambda: any(tmp_path.rglob("manifest.json")), start(*arguments, results=tmp_path))
    (record,) = Results(tmp_path).scan("run")[0]
    assert record.status == "unfinished"
    wait_until_free(record)
    done = succeed(*arguments, results=tmp_path)
    assert "was interrupted or failed; it starts again from the beginning" in done.stdout
    ended = Results(tmp_path).find("run", record.id)
    assert (ended.status, ended.rows("episodes")) == ("finished", 10)


def test_run_of_another_process_is_skipped_with_notice(tmp_path):
    arguments = train("td3", "none", "--steps", "100000", "--seeds", "0", "--checkpoint-every", "0")
    first = start(*arguments, results=tmp_path)
    try:
        wait_until(lambda: list(tmp_path.rglob("manifest.json")), first)
        (record,) = Results(tmp_path).scan("run")[0]
        second = succeed(*arguments, "--json", results=tmp_path)
        note = "Another process is training seed 0 of td3 face_direction full; it is left out here."
        assert note in second.stderr
        assert "Next:" not in second.stderr
        assert json.loads(second.stdout)["left"] == [record.id]
    finally:
        first.kill()
        first.wait()
    wait_until_free(record)
