"""Shorter episodes of the Jitterbug, in a test, in a file of tests, or in processes.

jbench reads their length from `jbench.task_specs.EPISODE_STEPS`, and nothing else sets it. Robots
with short episodes of their own are in `tests/short_tasks.py`.
"""

from unittest import mock

from jbench import task_specs

EPISODE = 50
"""Control steps of a short episode, unless a test says otherwise."""


def shorten_episodes(set_attribute=setattr, steps=EPISODE):
    """Makes the episodes of the Jitterbug shorter, in this process."""
    set_attribute(task_specs, "EPISODE_STEPS", steps)


def short_episodes(steps=EPISODE):
    """Makes the episodes of the Jitterbug shorter within a block, such as that of a fixture."""
    return mock.patch.object(task_specs, "EPISODE_STEPS", steps)


def statements(steps):
    """Returns Python statements that make the episodes of the Jitterbug shorter."""
    return f"import jbench.task_specs\njbench.task_specs.EPISODE_STEPS = {steps}\n"
