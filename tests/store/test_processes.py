"""Tests of killed and concurrent writers: exactly the committed rows are read."""

import random
import signal
import subprocess
import sys
import time

import pyarrow as pa
import pytest

from jbench.errors import WorkError
from jbench.store import Results
from tests.store.store_faults import Script
from tests.store.store_rows import listed, names, read

# Rows of one append have the same number; it is printed once the append has returned.
APPENDING = """
record = results.find("run", "a/b")
n = record.rows("t") // 3
while True:
    record.append({"t": numbers(n, n, n), "u": numbers(n)}, {"state.json": b"%d" % n})
    print(n, flush=True)
    n += 1
"""

# Recreates one record repeatedly, so that a kill may interrupt creation or compaction.
FINISHING = """
n = 0
while True:
    record = results.create("run", "a/b", {"n": n})
    for i in range(3):
        record.append({"t": numbers(n, i)})
    record.finish({"n": n}, {"policy.json": str(n).encode()})
    print(n, flush=True)
    n += 1
"""

HOLDING = """
with results.folder("run", "a/b").lock():
    print("held", flush=True)
    time.sleep(600)
"""


def killed_at_random(results, script, seed):
    """Kills a script at a random time after its first line; returns the numbers it printed."""
    with Script(results, script) as process:
        first = process.stdout.readline()
        time.sleep(random.Random(seed).uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        lines = [first, *process.stdout.readlines()]
    assert process.returncode == -signal.SIGKILL
    return [int(line) for line in lines if line.endswith("\n")]


@pytest.mark.parametrize("kills", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_killed_writer_leaves_complete_appends_including_all_reported(results, record, kills):
    done = 0
    for kill in range(kills):
        printed = killed_at_random(results, APPENDING, kill)
        assert printed == list(range(done, done + len(printed)))
        again = results.find("run", "a/b")
        numbered = read(again)
        assert numbered == [n for n in range(len(numbered) // 3) for _ in range(3)]
        assert read(again, "u") == numbered[::3]
        done = len(numbered) // 3
        assert again.read_file("state.json") == b"%d" % (done - 1)
        # The append that the kill interrupted may be committed but not yet reported.
        assert done - 1 - printed[-1] in (0, 1)
    again.finish({})
    assert read(again) == numbered
    assert names(record.path) == {"manifest.json", *listed(record)}


def test_record_is_consistent_after_kill_at_any_time(results):
    for kill in range(5):
        printed = killed_at_random(results, FINISHING, kill)
        again = results.find("run", "a/b")
        n = again.settings["n"]
        assert n - printed[-1] in (0, 1)
        whole = [n, 0, n, 1, n, 2]
        if again.status == "finished":
            assert read(again) == whole
            assert again.read_file("policy.json") == str(n).encode()
        else:
            assert read(again) in [whole[:end] for end in (0, 2, 4, 6)]


def test_lock_is_exclusive_and_released_when_its_holder_is_killed(results):
    folder = results.folder("run", "a/b")
    with Script(results, HOLDING) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(WorkError, match="Another process is writing the run a/b; wait"):
            folder.lock().__enter__()
        with results.folder("run", "a/c").lock():
            pass  # another folder's lock is another lock
        process.kill()
    with folder.lock(), pytest.raises(WorkError, match="Another process"):
        folder.lock().__enter__()


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads in /proc")
def test_process_that_exits_after_reading_exits_with_zero(tmp_path):
    # pyarrow's threads abort about half of such processes; see store/record_files.py.
    results = Results(tmp_path)
    record = results.create("run", "a/b", {})
    record.append({"t": pa.table({"n": [1, 2, 3]})})
    script = (
        "import os, sys, pathlib, pyarrow as pa, pyarrow.parquet\n"
        "from jbench.store import Results\n"
        "threads = lambda: len(os.listdir('/proc/self/task'))\n"
        "before = threads()\n"
        "record = Results(pathlib.Path(sys.argv[1])).find('run', 'a/b')\n"
        "print(record.read('t', pa.schema([('n', pa.int64())])).num_rows, threads() - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "3 0\n"), done.stderr
