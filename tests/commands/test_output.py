"""Tests of commands whose output cannot be written, or whose pipe is closed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from jbench.store import Results, query
from tests.store.store_whole import add_whole_run

LONG = "SELECT * FROM published"
FORMATS = ((), *(pytest.param((name,), marks=pytest.mark.slow) for name in ("--csv", "--json")))


def start(*arguments, results, stderr=subprocess.PIPE, **streams):
    command = [sys.executable, "-m", "jbench", *arguments, "--results", str(results)]
    return subprocess.Popen(command, stderr=stderr, **streams)


@pytest.mark.parametrize("format", FORMATS)
def test_closed_pipe_is_no_error(format, tmp_path):
    # As after `| head`.
    process = start("query", LONG, *format, results=tmp_path, stdout=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait() == 0


def test_work_goes_on_when_its_reader_has_gone(tmp_path):
    results = Results(tmp_path / "results")
    run = add_whole_run(results)
    (run.path / "policy.json").write_bytes(b"damaged")
    verified = start("verify", results=results.path, stdout=subprocess.PIPE)
    verified.stdout.close()
    assert b"Error: Some results are damaged" in verified.stderr.read()
    assert verified.wait() == 1


def test_streams_that_are_closed_take_no_file(tmp_path):
    """The number of a closed stream would be that of the next file, into which others print."""
    closed = {"preexec_fn": lambda: os.closerange(0, 3), "stderr": None}
    assert start("runs", results=tmp_path / "missing", **closed).wait() == 2
    script = "from jbench.commands import streams; streams.begin(outlives_reader=True)"
    printed = "import os; os.write(1, b'x'); os.write(2, b'x'); os.read(0, 1); open('file', 'x')"
    python = [sys.executable, "-c", f"{script}; {printed}"]
    child = subprocess.Popen(python, cwd=tmp_path, preexec_fn=closed["preexec_fn"])
    assert child.wait() == 0
    assert (tmp_path / "file").read_bytes() == b""


@pytest.mark.parametrize("format", FORMATS)
def test_output_to_full_disk_prints_one_error_line(format, tmp_path):
    with open("/dev/full", "w") as full:
        process = start("query", LONG, *format, results=tmp_path, stdout=full)
        printed = process.stderr.read().decode()
    assert printed == "Error: The output can't be written (No space left on device).\n"
    assert process.wait() == 1


def test_exit_code_is_kept_when_error_cannot_be_written(tmp_path):
    with open("/dev/full", "w") as full:
        assert start("runs", results=tmp_path / "missing", stderr=full).wait() == 2


def test_document_stands_alone_beside_what_an_environment_prints(run_command, tmp_path):
    typed = ("evaluate", "random", "--task", "tests.odd_tasks:talkative", "--episodes", "1")
    code, printed, said = run_command(*typed, "--json", results=tmp_path)
    assert code == 0
    assert json.loads(printed)["settings"]["episodes"] == 1
    assert "observed\n" in said

    _, printed, _ = run_command(*typed, "--seed", "1", results=tmp_path)
    assert "observed\n" in printed


def test_ctrl_c_interrupts_query(tmp_path, monkeypatch):
    begun, answer, here = threading.Event(), query._answer, threading.get_ident()

    def begin(*arguments):
        begun.set()
        return answer(*arguments)

    def interrupt_what_has_begun():
        if begun.wait(300):
            time.sleep(0.5)  # by then, DuckDB computes and this test waits
            signal.pthread_kill(here, signal.SIGINT)

    monkeypatch.setattr(query, "_answer", begin)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    interrupt = threading.Thread(target=interrupt_what_has_begun)
    sql = "SELECT count(*) FROM published, range(10000000000) a, range(9) b"
    try:
        interrupt.start()
        with pytest.raises(KeyboardInterrupt):
            query.query_results(Results(tmp_path), sql)
    finally:
        interrupt.join()
        signal.signal(signal.SIGINT, before)
    assert begun.is_set()
