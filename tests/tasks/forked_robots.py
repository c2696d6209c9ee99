"""A program that forks while it has robots with threads, for a separate process."""

import os

import numpy as np

from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots


def step_in_two_processes():
    """Prints the positions of four robots in a process and in its child; returns its exit code."""
    robots = Robots(load_model(), 4, 2)
    robots.step(np.ones(4))
    child = os.fork()
    print(robots.step(np.ones(4)).position.tolist(), flush=True)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) if child else 0
