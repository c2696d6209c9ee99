"""Runs commands and their workers in forks of this process, which has imported all modules."""

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
    """The exit code, the output and the counts of calls of a command."""

    code: int
    output: str
    counts: dict


class ForkedWorker:
    """Replaces `subprocess.Popen` by a worker forked from this process."""

    def __init__(self, command, **_):
        to_read, stdin = os.pipe()
        stdout, to_write = os.pipe()
        self.pid, self.returncode = os.fork(), None
        if self.pid == 0:
            _run_worker(to_read, to_write, (stdin, stdout), command[3:])
        os.close(to_read)
        os.close(to_write)
        self.stdin, self.stdout = os.fdopen(stdin, "w"), os.fdopen(stdout)

    def poll(self):
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            if ended:
                self.returncode = os.waitstatus_to_exitcode(status)
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


def _run_worker(stdin, stdout, others, arguments):
    """Runs a worker with these descriptors; does not return."""
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


def run_command(command, path, fault=None):
    """Runs a command in a new process, with or without a failing call."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as counted:
        process = os.fork()
        if process == 0:
            _run_and_exit(command, path, fault, output.fileno(), counted.fileno())
        _, status = os.waitpid(process, 0)
        output.seek(0)
        counted.seek(0)
        counts = json.loads(counted.read() or b"{}")
        return Ended(os.waitstatus_to_exitcode(status), output.read().decode(), counts)


def _run_and_exit(command, path, fault, output, counted):
    """Runs a command in this process, which ends."""
    code = 70
    try:
        os.dup2(output, 1)
        os.dup2(output, 2)
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
