"""Forks processes of commands, workers and test programs, which saves seconds of imports.

A server (`fork_server.py`), which has imported jbench and started no thread, forks each of them.
They have their own id, streams, environment and directory, and can be killed. All processes of a
test run share one server. Each command has its own one, from which its workers are forked: they
end with the command. Tests of the start of a process (`test_distribution.py`,
`training/test_processes.py`) start Python processes instead.
"""

import contextlib
import json
import os
import selectors
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from functools import cache, partial
from pathlib import Path

from jbench import task_specs

ROOT = Path(__file__).parents[1]
NUMBER = struct.Struct("i")
"""Format in which process ids, exit codes and the lengths of requests are sent."""

COMMAND, WORKER = "jbench.cli:main", "jbench.training.worker:main"

WORKER_NAME = "jbench-worker"
"""Name of a forked worker's process; its command line is that of the server."""

RUN = os.environ.get("PYTEST_XDIST_TESTRUNUID", uuid.uuid4().hex)
"""Identifies this run of pytest in all of its processes."""

SOCKET = Path(tempfile.gettempdir()) / f"jbench-{RUN}"
"""Where the server of this run listens."""


class Forked:
    """A process that a server forked, with the methods of `subprocess.Popen` that tests use."""

    def __init__(
        self,
        channel,
        target,
        arguments,
        streams,
        *,
        cwd=None,
        session=False,
        environ=os.environ,
        episode_steps=None,
    ):
        """Starts the process.

        Args:
            channel: socket of the server.
            target: "module:function" that it calls; what that returns is its exit code.
            arguments: of the function, as JSON.
            streams: its standard input, output and error, as descriptors.
            session: whether it leads a session, and so a process group, of its own.
            episode_steps: length of the Jitterbug's episodes there; None for that of this process.
        """
        request = {"target": target, "arguments": arguments, "session": session}
        request["environ"] = dict(environ)
        request["cwd"] = str(cwd or Path.cwd())
        request["episode_steps"] = episode_steps or task_specs.EPISODE_STEPS
        self._status, status = os.pipe()
        _send_request(channel, request, [*streams, status])
        os.close(status)
        self.returncode = None
        self.pid = self._receive()

    def poll(self):
        if self.returncode is None and self._ready(0):
            self.wait()
        return self.returncode

    def wait(self, timeout=None):
        if self.returncode is None:
            if not self._ready(timeout):
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            self.returncode = self._receive()
            os.close(self._status)
        return self.returncode

    def send_signal(self, number):
        if self.poll() is None:
            # The server may have collected it, and not yet have sent its exit code.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def _ready(self, timeout):
        with selectors.DefaultSelector() as selector:
            selector.register(self._status, selectors.EVENT_READ)
            return selector.select(timeout)

    def _receive(self):
        received = os.read(self._status, NUMBER.size)
        if not received:
            raise RuntimeError("the server of forked processes has died")
        return NUMBER.unpack(received)[0]


class Piped(Forked):
    """A process without input, with a pipe from `stdout` and this process's standard error."""

    def __init__(self, target, arguments, **options):
        output, printed = os.pipe()
        with open(os.devnull) as nothing:
            streams = (nothing.fileno(), printed, 2)
            super().__init__(server(), target, arguments, streams, **options)
        os.close(printed)
        self.stdout = os.fdopen(output)

    def __enter__(self):
        return self

    def __exit__(self, error, *_):
        self.stdout.close()
        if error is not None:
            self.kill()
        self.wait(120)


def forked_worker(channel):
    """Starts a worker; replaces `executors._start`."""
    to_read, stdin = os.pipe()
    stdout, to_write = os.pipe()
    environ = {**os.environ, "MUJOCO_GL": "disable"}
    process = Forked(channel, WORKER, [], (to_read, to_write, 2), environ=environ)
    os.close(to_read)
    os.close(to_write)
    process.stdin, process.stdout = os.fdopen(stdin, "w"), os.fdopen(stdout)
    return process


def fork_workers(patch):
    """Forks the workers of commands in this process, until the patch is undone."""
    start = partial(forked_worker, server())
    patch.setattr("jbench.sweeps.executors._start", start)


@cache
def server():
    """Returns this process's socket of the server, which ends with the last such process."""
    channel = socket.socket(socket.AF_UNIX)
    for _ in range(1000):
        try:
            channel.connect(str(SOCKET))
        except (FileNotFoundError, ConnectionRefusedError):
            _start_server()
        else:
            return channel
    raise RuntimeError("the server of forked processes has died")


def _start_server():
    """Starts the server, unless another process of this test run is starting it."""
    with socket.socket(socket.AF_UNIX) as listener:
        try:
            listener.bind(str(SOCKET))
        except OSError:
            time.sleep(0.01)
            return

        listener.listen()
        number = listener.fileno()
        command = [sys.executable, "-m", "tests.fork_server", str(number)]
        environ = {**os.environ, "PYTHONPATH": str(ROOT)}
        subprocess.Popen(command, pass_fds=[number], cwd=ROOT, env=environ)


_sending = threading.Lock()


def _send_request(channel, request, descriptors):
    """Sends a request and descriptors, whole, also where several threads do."""
    content = json.dumps(request).encode()
    with _sending:
        socket.send_fds(channel, [NUMBER.pack(len(content))], descriptors)
        channel.sendall(content)
