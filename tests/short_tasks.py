"""Tasks of other robots with short episodes, by MODULE:NAME."""

from dm_control import suite

EPISODE = 50
"""Control steps of an episode."""


def cheetah_run(random=None):
    """Six motors; a control step has 0.01 s."""
    return _load("cheetah", "run", random, EPISODE * 0.01)


def cartpole_swingup(random=None):
    """One motor; a control step has 0.01 s."""
    return _load("cartpole", "swingup", random, EPISODE * 0.01)


def _load(domain, task, random, seconds):
    return suite.load(domain, task, task_kwargs={"random": random, "time_limit": seconds})
