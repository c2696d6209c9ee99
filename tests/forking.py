"""Forks processes of commands, workers and test programs, which saves seconds of imports.

A server, which has imported jbench and started no thread, forks each of them. They have their own
id, streams, environment and directory, and can be killed. Each command has its own server, from
which its workers are forked: they end with the command. Tests of the start of a process
(`test_distribution.py`, `training/test_processes.py`) start Python processes instead.

`python -m tests.forking CHANNEL EPISODE_STEPS` is the server; CHANNEL is the descriptor of its
socket, EPISODE_STEPS the length of an episode in all that it forks.
"""

import contextlib
import gc
import importlib
import json
import os
import pkgutil
import selectors
import signal
import socket
import struct
import subprocess
import sys
import threading
import traceback
from functools import cache, partial
from pathlib import Path

from jbench import task_specs
from tests.page_cache import leave_in_page_cache
from tests.short_episodes import shorten_episodes

ROOT = Path(__file__).parents[1]
NUMBER = struct.Struct("i")
"""Format in which process ids, exit codes and the lengths of requests are sent."""

COMMAND, WORKER = "jbench.cli:main", "jbench.training.worker:main"


class Forked:
    """A process that a server forked, with the methods of `subprocess.Popen` that tests use."""

    def __init__(
        self, channel, target, arguments, streams, *, cwd=None, session=False, environ=os.environ
    ):
        """Starts the process.

        Args:
            channel: socket of the server.
            target: "module:function" that it calls; what that returns is its exit code.
            arguments: of the function, as JSON.
            streams: its standard input, output and error, as descriptors.
            session: whether it leads a session, and so a process group, of its own.
        """
        request = {"target": target, "arguments": arguments, "session": session}
        request["environ"] = dict(environ)
        request["cwd"] = str(cwd or Path.cwd())
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
            super().__init__(
                server(task_specs.EPISODE_STEPS), target, arguments, streams, **options
            )
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
    start = partial(forked_worker, server(task_specs.EPISODE_STEPS))
    patch.setattr("jbench.sweeps.executors._start", start)


@cache
def server(episode_steps):
    """Returns the socket of this process's server, which ends with this process."""
    ours, theirs = socket.socketpair()
    command = [sys.executable, "-m", "tests.forking", str(theirs.fileno()), str(episode_steps)]
    environ = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.Popen(command, pass_fds=[theirs.fileno()], cwd=ROOT, env=environ)
    theirs.close()
    return ours


_sending = threading.Lock()


def _send_request(channel, request, descriptors):
    """Sends a request and descriptors, whole, also where several threads do."""
    content = json.dumps(request).encode()
    with _sending:
        socket.send_fds(channel, [NUMBER.pack(len(content))], descriptors)
        channel.sendall(content)


def _receive_request(channel):
    """Returns a request and its descriptors; None once the other end is closed."""
    length, descriptors, *_ = socket.recv_fds(channel, NUMBER.size, 4)
    if not length:
        return None

    (size,) = NUMBER.unpack(length)
    content = bytearray()
    while len(content) < size:
        content += channel.recv(size - len(content))
    return json.loads(content), descriptors


def serve(channel):
    """Forks a process for each request, and sends its exit code, until the socket is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    ended, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    signal.set_wakeup_fd(wakeup)
    children = {}
    with selectors.DefaultSelector() as selector:
        selector.register(channel, selectors.EVENT_READ)
        selector.register(ended, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj == ended:
                    os.read(ended, 4096)
                    _send_codes(children)
                    continue
                received = _receive_request(channel)
                if received is None:
                    return
                request, (*streams, status) = received
                pid = os.fork()
                if pid == 0:
                    selector.close()
                    others = (channel.detach(), ended, wakeup, status, *children.values())
                    _run_request(request, streams, others)
                for handle in streams:
                    os.close(handle)
                children[pid] = status
                _send(status, pid)


def _send_codes(children):
    """Sends the exit codes of the children that have ended."""
    with contextlib.suppress(ChildProcessError):
        while (found := os.waitpid(-1, os.WNOHANG))[0]:
            status = children.pop(found[0])
            _send(status, os.waitstatus_to_exitcode(found[1]))
            os.close(status)


def _send(status, number):
    with contextlib.suppress(BrokenPipeError):  # the parent has ended
        os.write(status, NUMBER.pack(number))


def _run_request(request, streams, others):
    """Runs the function of a request in the forked process; does not return."""
    code = 70
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for handle in others:
            os.close(handle)
        for number, handle in enumerate(streams):
            os.dup2(handle, number)
            os.close(handle)
        sys.stdin = os.fdopen(0, closefd=False)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", closefd=False) for n in (1, 2))
        sys.__stdout__, sys.__stderr__ = sys.stdout, sys.stderr
        if request["session"]:
            os.setsid()
        os.environ.clear()
        os.environ.update(request["environ"])
        os.chdir(request["cwd"])
        paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
        sys.path[:0] = [path for path in paths if path and path not in sys.path]
        code = _call(request["target"], request["arguments"])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code or 0)


def _call(target, arguments):
    """Calls the function of a request; returns its exit code."""
    workers = contextlib.nullcontext()
    if target == COMMAND:
        sys.argv = ["jbench", *arguments[0]]
        signal.signal(signal.SIGINT, signal.default_int_handler)
        workers = _forked_workers()
    if target == WORKER and sys.platform == "linux":
        Path("/proc/self/comm").write_text(WORKER_NAME)
    with workers:
        return pkgutil.resolve_name(target)(*arguments)


WORKER_NAME = "jbench-worker"
"""Name of a forked worker's process; its command line is that of the server."""


@contextlib.contextmanager
def _forked_workers():
    """Starts a server for the workers of this command, before the command starts a thread."""
    from jbench.sweeps import executors

    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        ours.close()
        serve(theirs)
        os._exit(0)
    theirs.close()
    executors._start = partial(forked_worker, ours)
    yield
    ours.close()
    os.waitpid(pid, 0)


def import_all():
    """Imports all modules of jbench, and those that they import on first use."""
    for module in pkgutil.walk_packages([str(ROOT / "jbench")], "jbench."):
        with contextlib.suppress(ImportError):
            importlib.import_module(module.name)
    import torch

    torch.set_num_threads(1)
    # The first optimizer imports torch's compiler.
    torch.optim.Adam([torch.zeros(1, requires_grad=True)])
    # Frozen objects are not copied by the garbage collector of a forked process.
    gc.collect()
    gc.freeze()


if __name__ == "__main__":
    leave_in_page_cache()
    shorten_episodes(steps=int(sys.argv[2]))
    import_all()
    from jbench.encoders import reconstruction
    from jbench.training import engines

    # The speed of training is measured on few steps, encoders are evaluated on few episodes.
    engines._STEPS, engines._UPDATES = 20, 2
    reconstruction._EPISODES = 2
    with contextlib.suppress(KeyboardInterrupt):
        serve(socket.socket(fileno=int(sys.argv[1])))
