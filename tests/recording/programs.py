"""Programs that record a run, for separate processes; see `tests/forking.py`."""

import os
import runpy
import signal
import sys

import numpy as np

import jbench
from jbench import task_specs
from jbench.recording import writer


def record_two_episodes(results, what):
    """Records a run; "kill" kills the process in the second episode."""
    writer._COMMIT_EVERY = 0.0
    run = {"algo": "mine", "seed": 0, "steps": 2 * task_specs.EPISODE_STEPS, "hyperparameters": {}}
    with jbench.record("face_direction", **run, results=results, evaluate_episodes=0) as recording:
        env = recording.env()
        for episode in range(2):
            env.reset()
            for _ in range(task_specs.EPISODE_STEPS):
                env.step(np.zeros(1))
                if what == "kill" and episode == 1:
                    os.kill(os.getpid(), signal.SIGKILL)


def run_script(script, *arguments):
    """Runs a Python file as a program."""
    sys.argv = [script, *arguments]
    runpy.run_path(script, run_name="__main__")
