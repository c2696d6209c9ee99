"""The server that forks the processes of tests; see `forking.py`.

`python -m tests.fork_server LISTENER` is that of a test run; LISTENER is the descriptor of the
socket that listens. It ends with the last process of the run that has connected.
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
import sys
import traceback
from functools import partial
from pathlib import Path

from jbench import installed
from tests.forking import COMMAND, NUMBER, ROOT, WORKER, WORKER_NAME, forked_worker
from tests.page_cache import leave_in_page_cache
from tests.short_episodes import shorten_episodes

TRAINING = frozenset({"train", "train-agent", "sweep", "demo"})
"""Verbs that start workers."""


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


class Server:
    """Forks a process for each request, and sends its exit code."""

    def __init__(self, channels=(), listener=None):
        """Takes the requests of these sockets, and of those that the listener accepts."""
        self._channels = set(channels)
        self._listener = listener
        self._children = {}  # where the exit code of each process is sent
        self._ended, self._wakeup = os.pipe()
        os.set_blocking(self._wakeup, False)
        self._selector = selectors.DefaultSelector()
        for file in (self._ended, *self._sockets()):
            self._selector.register(file, selectors.EVENT_READ)

    def serve(self):
        """Serves until each socket has been closed at its other end."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._wakeup)
        while True:
            for key, _ in self._selector.select():
                if key.fileobj == self._ended:
                    os.read(self._ended, 4096)
                    self._send_codes()
                elif key.fileobj is self._listener:
                    self._accept()
                else:
                    self._answer(key.fileobj)
            if not self._channels and not self._accept_last():
                return

    def _sockets(self):
        listeners = () if self._listener is None else (self._listener,)
        return (*self._channels, *listeners)

    def _accept(self):
        channel, _ = self._listener.accept()
        self._channels.add(channel)
        self._selector.register(channel, selectors.EVENT_READ)

    def _accept_last(self):
        """Makes way for another server; returns whether a process has connected meanwhile."""
        if self._listener is None:
            return False
        Path(self._listener.getsockname()).unlink(missing_ok=True)
        if not any(key.fileobj is self._listener for key, _ in self._selector.select(0)):
            return False
        self._accept()
        return True

    def _answer(self, channel):
        received = _receive_request(channel)
        if received is None:
            self._selector.unregister(channel)
            self._channels.remove(channel)
            channel.close()
            return

        request, (*streams, status) = received
        pid = os.fork()
        if pid == 0:
            self._selector.close()
            others = [file.detach() for file in self._sockets()]
            others += [self._ended, self._wakeup, status, *self._children.values()]
            _run_request(request, streams, others)
        for handle in streams:
            os.close(handle)
        self._children[pid] = status
        _send(status, pid)

    def _send_codes(self):
        """Sends the exit codes of the processes that have ended."""
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                status = self._children.pop(found[0])
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
        shorten_episodes(steps=request["episode_steps"])
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
        if not TRAINING.isdisjoint(arguments[0][:1]):
            workers = _forked_workers()
    if target == WORKER and sys.platform == "linux":
        Path("/proc/self/comm").write_text(WORKER_NAME)
    with workers:
        return pkgutil.resolve_name(target)(*arguments)


@contextlib.contextmanager
def _forked_workers():
    """Starts a server for the workers of this command, before the command starts a thread."""
    from jbench.sweeps import executors

    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        ours.close()
        Server([theirs]).serve()
        os._exit(0)
    theirs.close()
    executors._start = partial(forked_worker, ours)
    yield
    ours.close()
    os.waitpid(pid, 0)


def import_all():
    """Imports all modules of jbench, those that they import on first use, and what is installed."""
    gc.disable()  # it would take a fifth of the time
    for module in pkgutil.walk_packages([str(ROOT / "jbench")], "jbench."):
        with contextlib.suppress(ImportError):
            importlib.import_module(module.name)
    import torch

    torch.set_num_threads(1)
    # The first optimizer imports torch's compiler.
    torch.optim.Adam([torch.zeros(1, requires_grad=True)])
    installed.packages()
    installed.offered("jbench.tasks")
    # Frozen objects are not copied by the garbage collector of a forked process.
    gc.collect()
    gc.freeze()
    gc.enable()


if __name__ == "__main__":
    leave_in_page_cache()
    import_all()
    from jbench.encoders import reconstruction
    from jbench.training import speed

    # The speed of training is measured on few steps, encoders are evaluated on few episodes.
    speed._STEPS = 20
    speed._UPDATES = 2
    reconstruction._EPISODES = 2
    with contextlib.suppress(KeyboardInterrupt):
        Server(listener=socket.socket(fileno=int(sys.argv[1]))).serve()
