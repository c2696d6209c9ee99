"""Tests that a killed command (SIGKILL) leaves a readable database and resumes when repeated.

Episodes are short.
"""

import json
from functools import partial

import pytest

from jbench.store import Results, locks
from jbench.store.tables import read_tables
from tests import command_line
from tests.command_line import SHORT, kill_when, train, wait_until

jbench = partial(command_line.jbench, short=True)
start = partial(command_line.start, short=True)
succeed = partial(command_line.succeed, short=True)


@pytest.mark.slow
def test_killed_collection_is_readable_and_resumes(tmp_path):
    # The dataset has one file, written seconds after the manifest.
    steps = ("collect", "--steps", "2000")
    kill_when(lambda: any(tmp_path.rglob("manifest.json")), start(*steps, results=tmp_path))
    (row,) = read_tables(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("unfinished", 0)
    refused = jbench("train-dae", results=tmp_path)
    assert refused.returncode == 2
    assert "No finished dataset" in refused.stderr
    succeed(*steps, results=tmp_path)
    (row,) = read_tables(Results(tmp_path)).tables["datasets"].to_pylist()
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
    arguments = train("td3", "none", "--steps", "600", "--jobs", "1")
    checkpoints = (*arguments, "--checkpoint-every", "0")
    process = start(*checkpoints, results=tmp_path)
    kill_when(lambda: len(list(tmp_path.rglob("checkpoint-*"))) >= 3, process)
    results = Results(tmp_path)
    for record in results.scan("run")[0]:
        wait_until_free(record)
    records, problems = results.scan("run")
    assert (len(records), problems) == (2, [])
    for record in records:
        assert record.status == "unfinished"
        assert set(record.read("episodes")["length"].to_pylist()) <= {SHORT}
    done = succeed(*arguments, results=tmp_path)
    for record in records:
        assert f"{record.id} was interrupted or failed; it resumes at control step" in done.stdout
        ended = results.find("run", record.id)
        assert ended.status == "finished"
        assert ended.rows("episodes") == 6
        (continued,) = ended.manifest.provenance["continued"]
        assert continued["control_steps"] >= SHORT
        assert continued["changed"] == {}
    assert not list(tmp_path.rglob("checkpoint-*"))


def test_run_of_another_process_is_skipped_with_notice(tmp_path):
    arguments = train("td3", "none", "--steps", "100000", "--seeds", "0", "--checkpoint-every", "0")
    first = start(*arguments, results=tmp_path)
    try:
        wait_until(lambda: list(tmp_path.rglob("manifest.json")), first)
        (record,) = Results(tmp_path).scan("run")[0]
        second = jbench(*arguments, "--json", results=tmp_path)
        assert second.returncode == 3
        assert "Error: Another process is training 1 of 1 run; jbench runs shows" in second.stderr
        note = "Another process is training seed 0 of td3 face_direction full; it is left out here."
        assert note in second.stderr
        assert "Next:" not in second.stderr
        assert json.loads(second.stdout)["left"] == [record.id]
    finally:
        first.kill()
        first.wait()
    wait_until_free(record)
