"""The demo command."""

import contextlib
import shlex
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import typer

from jbench.commands.options import ResultsOption
from jbench.commands.output import Output

# Smaller networks and batches, and fewer random first steps than the paper's TD3, so that it learns
# in minutes.
_AGENTS = (
    "train --algo td3 --seeds 0-1 --steps 25000 --set hidden_layers=[128,128] "
    "--set batch_size=64 --set learning_rate=1e-3 --set learning_starts=5000 --evaluate-episodes 5"
)

COMMANDS = (
    "collect --steps 50000",
    "train-dae --latent 12 --epochs 100 --batch 256",
    f"{_AGENTS} --encoder none",
    f"{_AGENTS} --encoder 12",
    "report --window 5",
)
"""The commands of the demo, without `jbench` and `--results`."""

_RESULTS = Path("demo-results")


def demo(context: typer.Context, results: ResultsOption = _RESULTS) -> None:
    """Run the whole pipeline on a small scale, in minutes.

    It collects a dataset, trains an encoder and agents, and writes a report.
    """
    output = Output()
    output.say(
        "jbench demo: TD3 on face_direction, full and encoded, 2 seeds; networks of [128, 128]\n"
        "instead of the paper's [350, 250], 25,000 steps instead of 5,000,000."
    )
    for command in COMMANDS:
        arguments = [*command.split(), "--results", str(results)]
        output.say(f"\n$ {shlex.join(['jbench', *arguments])}")
        with _recorded_as(arguments):
            answer = context.find_root().command.main(
                arguments, prog_name="jbench", standalone_mode=False
            )
        if answer == 128 + signal.SIGINT:  # typer returns this on Ctrl-C
            raise KeyboardInterrupt
    output.say(
        f"\nThe report: {results / 'report' / 'index.html'}\n"
        "Next, the paper's experiment on one task (it takes days; --steps and --seeds make it "
        "shorter):\n"
        "  jbench collect && jbench train-dae &&\n"
        "  jbench train --algo ddpg --encoder 12 && jbench report"
    )


@contextlib.contextmanager
def _recorded_as(arguments: list[str]) -> Iterator[None]:
    """Makes records contain a command of the demo, as if it had been typed alone."""
    before = sys.argv
    sys.argv = ["jbench", *arguments]
    try:
        yield
    finally:
        sys.argv = before
