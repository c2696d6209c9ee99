"""Trains a small run and kills its own process (SIGKILL) after some control steps.

    python -m tests.agents.killed_run '{"path": DIR, "run": {…}, "device": "cpu", "after": 150}'

The seeds are computed in one stack on every device, unless "stacked" is false.
"""

import functools
import json
import os
import signal
import sys
from pathlib import Path

from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training import batched_run, engines
from jbench.training.events import EpisodeEnded
from tests.short_episodes import shorten_episodes


def stack_seeds(set_attribute=setattr):
    """Makes engines compute their seeds in one stack on a CPU, too."""
    stacked = functools.partial(engines.make_batched_engine, stacked=True)
    set_attribute(engines, "make_batched_engine", stacked)


def main(path, run, device, after, stacked=True):
    def kill(event):
        if isinstance(event, EpisodeEnded) and event.control_steps > after:
            os.kill(os.getpid(), signal.SIGKILL)

    shorten_episodes()
    if stacked:
        stack_seeds()
    runs = [RunSettings(**run)]
    batched_run.run_batch(runs, Results(Path(path)), device=device, checkpoint_every=0, report=kill)


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
