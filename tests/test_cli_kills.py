"""A verb that is killed (SIGKILL) leaves a database that reads, and goes on when typed again."""

import signal
import subprocess
import sys
import time

from command_line import jbench, succeed, train

from jbench.store import Results, schema
from jbench.store.query import load


def kill_when(arguments, results, ready):
    """Starts a verb, and kills it and nothing else (SIGKILL) once something is there."""
    process = subprocess.Popen(
        [sys.executable, "-m", "jbench.cli", *arguments, "--results", str(results)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 120
    while not ready():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()


def test_killed_while_collecting_it_reads_and_continues(tmp_path):
    # One file, that is seconds away when the manifest is there.
    steps = ("collect", "--steps", "8000")
    kill_when(steps, tmp_path, lambda: any(tmp_path.rglob("manifest.json")))
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("unfinished", 0)
    refused = jbench("train-dae", results=tmp_path)
    assert refused.returncode == 2
    assert "No finished dataset" in refused.stderr
    succeed(*steps, results=tmp_path)
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("finished", 8000)
    # A file that the kill left unlisted is gone: every file there is in the manifest.
    listed = {
        entry.name for entry in Results(tmp_path).find("dataset", row["dataset"]).parts("steps")
    }
    assert {path.name for path in tmp_path.rglob("steps-*.parquet")} == listed


def test_killed_while_training_the_database_reads_and_the_run_starts_over(tmp_path):
    arguments = train("td3", "none", "--steps", "6000", "--seeds", "0")
    kill_when(arguments, tmp_path, lambda: any(tmp_path.rglob("manifest.json")))
    (manifest,) = tmp_path.rglob("manifest.json")
    results = Results(tmp_path)
    record = results.find("run", manifest.parent.relative_to(tmp_path / "runs").as_posix())
    assert record.status == "unfinished"
    rows = record.read("episodes", schema.EPISODES)
    assert set(rows["length"].to_pylist()) <= {1000}
    # The worker ends with its parent: the lock is free and nobody writes any more.
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            with record.lock():
                break
        except Exception:
            time.sleep(0.1)
    done = succeed(*arguments, results=tmp_path)
    assert "was interrupted or failed; it starts over" in done.stdout
    assert results.find("run", record.id).status == "finished"
    assert results.find("run", record.id).rows("episodes") == 6
