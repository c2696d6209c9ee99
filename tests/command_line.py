"""The command line as its users type it: in processes of its own."""

import subprocess
import sys

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


def jbench(*arguments, results=None, cwd=None):
    """Runs the command line; returns the finished process."""
    where = () if results is None else ("--results", str(results))
    return subprocess.run(
        [sys.executable, "-m", "jbench.cli", *arguments, *where],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=300,
    )


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
