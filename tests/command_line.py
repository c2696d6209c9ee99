"""The command line as its users type it: in processes of its own."""

import subprocess
import sys
import tempfile

from tests.forking import COMMAND, Forked, server

# What is started in the background of a script ignores Ctrl-C, and so do its children: this does
# not, wherever the tests were started.
INTERRUPTIBLE = (
    sys.executable,
    "-c",
    "import signal, sys\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from jbench.cli import main\n"
    "sys.exit(main(sys.argv[1:]))\n",
)


class Command(Forked):
    """A command that is being executed; its output is kept in files."""

    def __init__(self, *arguments, results=None, cwd=None):
        where = () if results is None else ("--results", str(results))
        self._out, self._err = (tempfile.TemporaryFile("w+") for _ in range(2))
        typed = [[*map(str, arguments), *where]]
        with open("/dev/null") as nothing:
            streams = [file.fileno() for file in (nothing, self._out, self._err)]
            super().__init__(server(), COMMAND, typed, streams, cwd=cwd, session=True)

    def communicate(self, timeout=None):
        """Waits for its end; returns its output and errors."""
        self.wait(timeout)
        for file in (self._out, self._err):
            file.seek(0)
        return self._out.read(), self._err.read()


def jbench(*arguments, results=None, cwd=None):
    """Runs the command line; returns the finished process."""
    process = Command(*arguments, results=results, cwd=cwd)
    out, err = process.communicate(timeout=300)
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def succeed(*arguments, results):
    done = jbench(*arguments, results=results)
    assert done.returncode == 0, done.stderr
    return done


SMALL = ("--set", "hidden_layers=[8]", "--set", "batch_size=8")
OFF_POLICY = (
    *("--set", "learning_starts=1000", "--set", "train_freq=100", "--set", "gradient_steps=1"),
)
TRAINING = {
    "ddpg": (*SMALL, *OFF_POLICY),
    "td3": (*SMALL, *OFF_POLICY),
    "sac": (*SMALL, *OFF_POLICY),
    "ppo": (*SMALL, "--set", "n_envs=2", "--set", "n_steps=256"),
}


def train(algo, encoder, *more):
    """Arguments of a small training of two seeds."""
    return (
        *("train", "--algo", algo, "--encoder", encoder, "--seeds", "0-1", "--steps", "2000"),
        *("--evaluate-episodes", "1", *TRAINING[algo], *more),
    )
