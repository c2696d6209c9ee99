"""Whatever happens to the process that writes, what was committed is read, and nothing else."""

import contextlib
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
from tests.store.store_rows import listed, names, numbers, read

# Rows of one append have the same number; it is printed once the append has returned.
APPENDING = """
record = results.find("run", "a/b")
n = record.rows("t") // 3
while True:
    record.append({"t": numbers(n, n, n), "u": numbers(n)})
    print(n, flush=True)
    n += 1
"""

# The same record over and over, so that a kill may fall into starting over and into compaction.
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
with results.record("run", "a/b").lock():
    print("held", flush=True)
    time.sleep(600)
"""

WITHOUT_ROOM = """
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    results.find("run", "a/b").append({"t": numbers(2), "u": incompressible(10_000)})
except WorkError as error:
    print(error)
"""


@contextlib.contextmanager
def process_of(results, script):
    """Runs a script until the end of the block, however that comes."""
    with Script(results, script) as process:
        try:
            yield process
        finally:
            process.kill()


def killed_at_random(results, script, seed):
    """Runs a script, kills it some commits after its first line; returns what it printed."""
    with process_of(results, script) as process:
        first = process.stdout.readline()
        time.sleep(random.Random(seed).uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        lines = [first, *process.stdout.readlines()]
    assert process.returncode == -signal.SIGKILL
    return [int(line) for line in lines if line.endswith("\n")]


@pytest.mark.parametrize("kills", [4, pytest.param(10, marks=pytest.mark.slow)])
def test_killed_writer_leaves_whole_appends_and_every_one_that_it_reported(results, record, kills):
    done = 0
    for kill in range(kills):
        printed = killed_at_random(results, APPENDING, kill)
        assert printed == list(range(done, done + len(printed)))
        again = results.find("run", "a/b")
        numbered = read(again)
        assert numbered == [n for n in range(len(numbered) // 3) for _ in range(3)]
        assert read(again, "u") == numbered[::3]
        done = len(numbered) // 3
        # The one that the kill fell into may be committed, though not yet reported.
        assert done - 1 - printed[-1] in (0, 1)
    again.finish({})
    assert read(again) == numbered
    assert names(record.path) == {"manifest.json", *listed(record)}


def test_killed_in_any_state_of_its_work_a_record_is_one_of_its_states(results):
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


def test_append_without_room_for_its_second_table_commits_neither(results, record):
    record.append({"t": numbers(1)})
    with process_of(results, WITHOUT_ROOM) as process:
        said = process.stdout.read()
    assert said.startswith("No room left to write u-00000-")
    again = results.find("run", "a/b")
    assert (read(again), read(again, "u")) == ([1], [])
    again.clean()
    assert names(record.path) == {"manifest.json", *listed(record)}


def test_lock_is_refused_while_another_process_holds_it_and_free_once_it_is_killed(results):
    record = results.record("run", "a/b")
    with process_of(results, HOLDING) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(WorkError, match="Another process is writing the run a/b; wait"):
            record.lock().__enter__()
        with results.record("run", "a/c").lock():
            pass  # another record's lock is another lock
    with record.lock(), pytest.raises(WorkError, match="Another process"):
        record.lock().__enter__()


def test_lock_is_let_go_after_an_error(results):
    record = results.record("run", "a/b")
    with pytest.raises(KeyError), record.lock():
        raise KeyError
    with record.lock(), pytest.raises(WorkError, match="Another process"):
        Results(results.path).record("run", "a/b").lock().__enter__()


def test_a_process_that_ends_right_after_reading_ends_well(tmp_path):
    # pyarrow's threads abort about half of such processes; see store/parquet.py.
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
