"""Makes files on several cores, in forked processes.

Forked processes already have the data of a report, so that only the contents of files are copied
between processes. Each process, including this one, takes a task at a time. This process repeats
tasks that another process did not finish, so that their errors are raised here.
"""

import contextlib
import gc
import json
import os
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import IO

Task = Callable[[], dict[str, bytes]]
"""Returns the content of files by name."""

_TOKEN = 4  # bytes of a task's number in the queue


def files_of(tasks: Sequence[Task], processes: int) -> dict[str, bytes]:
    """Returns the files of all tasks in their order.

    Args:
        tasks: tasks that neither depend on each other nor change anything; the last ones are begun
            first, and should be the longest.
        processes: maximum number of processes. Only this one is used where forking is unsafe: on
            other systems than Linux, and beside other threads of Python.
    """
    made: dict[int, dict[str, bytes]] = {}
    if sys.platform == "linux" and threading.active_count() == 1:
        # Raised without space for temporary files, or without memory for a process.
        with contextlib.suppress(OSError):
            made = _forked(tasks, min(processes, len(tasks)))
    parts = (made[i] if i in made else task() for i, task in enumerate(tasks))
    return {name: content for part in parts for name, content in part.items()}


def _forked(tasks: Sequence[Task], processes: int) -> dict[int, dict[str, bytes]]:
    """Returns the files of the tasks that were finished, by the task's number."""
    queue, end = os.pipe()
    os.write(end, b"".join(i.to_bytes(_TOKEN) for i in reversed(range(len(tasks)))))
    os.close(end)
    sinks: dict[int, IO[bytes]] = {}
    with contextlib.ExitStack() as stack:
        stack.callback(os.close, queue)
        # Collecting garbage would write to the existing objects, and so copy them to each process.
        gc.freeze()
        stack.callback(gc.unfreeze)
        for _ in range(processes - 1):
            sink: IO[bytes] = stack.enter_context(tempfile.TemporaryFile())
            pid = _fork(tasks, queue, sink)
            sinks[pid] = sink
            stack.callback(_end, pid)
        made = {i: tasks[i]() for i in _taken(queue)}
        for pid, sink in sinks.items():
            os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
            made |= _read(sink)
    return made


def _fork(tasks: Sequence[Task], queue: int, sink: IO[bytes]) -> int:
    """Starts a process that takes tasks from the queue and writes their files."""
    with warnings.catch_warnings():
        # Python warns of other threads; these are idle threads of numerical libraries.
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        for i in _taken(queue):
            _write(sink, i, tasks[i]())
        status = 0
    finally:
        os._exit(status)


def _end(pid: int) -> None:
    """Kills a process, which is still running only if this one has failed."""
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)


def _taken(queue: int) -> Iterator[int]:
    """Yields the numbers of tasks that no other process has taken."""
    while token := os.read(queue, _TOKEN):
        yield int.from_bytes(token)


def _write(sink: IO[bytes], task: int, files: dict[str, bytes]) -> None:
    sizes = {name: len(content) for name, content in files.items()}
    sink.write(json.dumps({"task": task, "sizes": sizes}).encode() + b"\n")
    sink.writelines(files.values())
    sink.flush()


def _read(sink: IO[bytes]) -> dict[int, dict[str, bytes]]:
    """Returns the files of complete tasks."""
    made: dict[int, dict[str, bytes]] = {}
    sink.seek(0)
    while line := sink.readline():
        head = json.loads(line)
        files = {name: sink.read(size) for name, size in head["sizes"].items()}
        if any(len(files[name]) < size for name, size in head["sizes"].items()):
            break  # the process was killed, or the disk is full
        made[head["task"]] = files
    return made
