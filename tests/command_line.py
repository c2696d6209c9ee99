"""Runs jbench commands in separate processes, which are forked; see `forking.py`."""

import os
import signal
import subprocess
import sys
import tempfile
import time

from jbench.task_specs import EPISODE_STEPS
from tests.forking import COMMAND, ROOT, Forked, server
from tests.json_documents import check_document
from tests.short_episodes import statements

# Background processes of a script ignore Ctrl-C; this command restores it.
INTERRUPTIBLE = (
    sys.executable,
    "-c",
    "import signal, sys\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from jbench.cli import main\n"
    "sys.exit(main(sys.argv[1:]))\n",
)


SHORT = 100
"""Control steps of an episode in processes that are started with `short`."""


def with_short_episodes(folder):
    """Returns an environment for Python processes in which episodes are short.

    Args:
        folder: where the module is written that each of them imports first.
    """
    (folder / "sitecustomize.py").write_text(statements(SHORT))
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


class Process(Forked):
    """A process in its own process group that calls a function; its output is in files."""

    def __init__(self, target, *arguments, cwd=None, short=False):
        self._out, self._err = tempfile.TemporaryFile("w+"), tempfile.TemporaryFile("w+")  # noqa: SIM115
        with open("/dev/null") as nothing:
            streams = [file.fileno() for file in (nothing, self._out, self._err)]
            steps = SHORT if short else EPISODE_STEPS
            where = {"cwd": cwd, "session": True, "episode_steps": steps}
            super().__init__(server(), target, arguments, streams, **where)

    def communicate(self, timeout=None):
        """Waits until the process ends; returns its standard output and standard error."""
        self.wait(timeout)
        for file in (self._out, self._err):
            file.seek(0)
        return self._out.read(), self._err.read()

    def printed(self):
        """Returns the standard output so far."""
        return _so_far(self._out)

    def said(self):
        """Returns the standard error so far."""
        return _so_far(self._err)

    def finished(self):
        """Waits until the process ends; returns the same as `subprocess.run`."""
        out, err = self.communicate(timeout=600)
        return subprocess.CompletedProcess((), self.returncode, out, err)


def _so_far(file):
    """Returns the text of a file, without a move in it, since a process writes there."""
    return os.pread(file.fileno(), os.fstat(file.fileno()).st_size, 0).decode()


def start(*arguments, results=None, cwd=None, short=False):
    """Starts a jbench command; returns the process."""
    where = () if results is None else ("--results", str(results))
    return Process(COMMAND, [*map(str, arguments), *where], cwd=cwd, short=short)


def jbench(*arguments, **options):
    """Runs a jbench command, whose JSON must fit its schema; returns the completed process."""
    done = start(*arguments, **options).finished()
    check_document(arguments, done.stdout)
    return done


def succeed(*arguments, results, short=False):
    done = jbench(*arguments, results=results, short=short)
    assert done.returncode == 0, done.stderr
    return done


def wait_until(condition, process=None, seconds=300):
    """Returns the value of a condition once it is true; the process must not end before."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.02)
    return value


def kill_when(condition, process):
    """Kills a process (SIGKILL), but not its children, once a condition is true."""
    wait_until(condition, process)
    process.send_signal(signal.SIGKILL)
    process.wait()


SMALL = ("--set", "hidden_layers=[8]", "--set", "batch_size=8")
OFF_POLICY = ("--set", "learning_starts=20", "--set", "train_freq=20", "--set", "gradient_steps=1")
TRAINING = dict.fromkeys(("ddpg", "td3", "sac"), (*SMALL, *OFF_POLICY))
TRAINING["ppo"] = (*SMALL, "--set", "n_envs=2", "--set", "n_steps=100")


def train(algo, encoder, *more):
    """Arguments of a small training of two seeds."""
    command = f"train --algo {algo} --encoder {encoder} --seeds 0-1 --steps 2000"
    return (*command.split(), "--evaluate-episodes", "1", *TRAINING[algo], *more)
