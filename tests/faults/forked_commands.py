"""Commands and their workers in processes forked from this one, which has imported everything."""

import contextlib
import json
import os
import signal
import sys
import tempfile
import traceback
from typing import NamedTuple

from jbench.cli import main
from jbench.training import worker
from tests.faults.fault_injection import Injector


class Ended(NamedTuple):
    """How a command ended: its exit code, its output, and how often it made each call."""

    code: int
    said: str
    counts: dict


class ForkedWorker:
    """Replaces `subprocess.Popen`: a worker forked from this process, with all its imports."""

    def __init__(self, command, **_):
        to_read, stdin = os.pipe()
        stdout, to_write = os.pipe()
        self.pid, self.returncode = os.fork(), None
        if self.pid == 0:
            _become(to_read, to_write, (stdin, stdout), command[3:])
        os.close(to_read)
        os.close(to_write)
        self.stdin, self.stdout = os.fdopen(stdin, "w"), os.fdopen(stdout)

    def poll(self):
        if self.returncode is None and os.waitpid(self.pid, os.WNOHANG)[0]:
            self.returncode = 0
        return self.returncode

    def wait(self):
        if self.returncode is None:
            _, status = os.waitpid(self.pid, 0)
            self.returncode = os.waitstatus_to_exitcode(status)
        for stream in (self.stdin, self.stdout):
            with contextlib.suppress(OSError):
                stream.close()
        return self.returncode

    def kill(self):
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)


def _become(stdin, stdout, others, arguments):
    """Becomes a worker with these descriptors; does not return."""
    code = 1
    try:
        os.dup2(stdin, 0)
        os.dup2(stdout, 1)
        for handle in (*others, stdin, stdout):
            os.close(handle)
        sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
        code = worker.main(*arguments)
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def typed(command, path, fault=None):
    """Types a command in a process of its own, with a failing call or without."""
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as counted:
        process = os.fork()
        if process == 0:
            _type(command, path, fault, said.fileno(), counted.fileno())
        _, status = os.waitpid(process, 0)
        said.seek(0)
        counted.seek(0)
        counts = json.loads(counted.read() or b"{}")
        return Ended(os.waitstatus_to_exitcode(status), said.read().decode(), counts)


def _type(command, path, fault, said, counted):
    """Types a command in this process, which ends."""
    code = 70
    try:
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", 1, closefd=False) for n in (1, 2))
        arguments = [word.format(path=path) for word in command]
        sys.argv = ["jbench", *arguments]
        injector = Injector(path, fault)
        code = main([*arguments, "--results", str(path)])
        os.write(counted, json.dumps(injector.counts()).encode())
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
