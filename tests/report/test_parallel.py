"""Tests of drawing files in several processes."""

import os
import signal
import sys
import time

import pytest

from jbench.report import parallel

FORKS = pytest.mark.skipif(sys.platform != "linux", reason="one process elsewhere")


@pytest.fixture(autouse=True)
def without_other_threads(monkeypatch):
    """Hides threads left by earlier tests, because a process with threads is not forked."""
    monkeypatch.setattr(parallel.threading, "active_count", lambda: 1)


def makes(name, content=b""):
    """Returns a task that makes one file, which holds its process id and a content."""
    return lambda: {name: b"%d %b" % (os.getpid(), content)}


def waits(name, folder=None):
    """Returns a task that lasts long enough for another process to start one too.

    With a folder, it waits until two processes have started tasks with this folder.
    """

    def task():
        if folder is None:
            time.sleep(0.2)
        else:
            (folder / str(os.getpid())).touch()
            end = time.monotonic() + 60
            while len(list(folder.iterdir())) < 2 and time.monotonic() < end:
                time.sleep(0.01)
        return {name: b"%d " % os.getpid()}

    return task


@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_files_are_in_order_of_tasks(processes):
    contents = [bytes([i]) * (i << 14) for i in range(6)]
    tasks = [makes(str(i), content) for i, content in enumerate(contents)]
    files = parallel.files_of(tasks, processes)
    assert [*files] == ["0", "1", "2", "3", "4", "5"]
    assert [file.partition(b" ")[2] for file in files.values()] == contents


@FORKS
def test_tasks_are_distributed_over_processes(tmp_path):
    files = parallel.files_of([waits(str(i), tmp_path) for i in range(4)], 2)
    processes = {int(content) for content in files.values()}
    assert len(processes) == 2
    assert os.getpid() in processes


@FORKS
def test_task_of_killed_process_is_repeated():
    own = os.getpid()

    def dies_elsewhere():
        if os.getpid() != own:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.2)
        return {"a": b"%d" % os.getpid()}

    files = parallel.files_of([dies_elsewhere, dies_elsewhere, waits("b")], 2)
    assert files == {"a": b"%d" % own, "b": files["b"]}


@FORKS
def test_one_process_makes_files_without_temporary_space(monkeypatch):
    def full():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(parallel.tempfile, "TemporaryFile", full)
    files = parallel.files_of([waits("a"), waits("b")], 2)
    assert {int(content) for content in files.values()} == {os.getpid()}


def test_error_is_raised_and_no_process_remains(monkeypatch):
    started, fork = [], parallel._fork
    monkeypatch.setattr(
        parallel, "_fork", lambda *given: started.append(fork(*given)) or started[-1]
    )

    def fails():
        raise ValueError("no figure")

    with pytest.raises(ValueError, match="no figure"):
        parallel.files_of([waits("a"), fails, waits("b"), fails], 2)
    for process in started:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
