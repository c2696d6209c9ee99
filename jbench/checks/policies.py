"""Checks of policies of others."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from jbench.checks.checked import NamedCheck, NotableError
from jbench.errors import WorkError
from jbench.policies.find import ActingPolicy, find_policy
from jbench.store import Results
from jbench.tasks.find import find_task

_EPISODES = 3
_STEPS = 100


def checks(name: str, task: str) -> Iterator[NamedCheck]:
    """Yields the checks of a policy."""
    yield "acts", partial(_acts, name, task)
    yield "episodes", partial(_episodes, name, task)


def _find(name: str, task: str) -> ActingPolicy:
    """Returns a new copy of the policy, without what an episode left in the last one."""
    return find_policy(Results("results"), name, task)


def _acts(name: str, task: str) -> str:
    """Checks the shape of actions for any number of robots."""
    policy = _find(name, task)
    about = find_task(task)
    for count in (1, 5):
        policy.reset(count)
        actions = policy.act(np.zeros((count, about.observation_size), np.float32))
        if actions.shape != (count, about.action_size):
            raise WorkError(f"it returns the shape {actions.shape} for {count} observations.")
    return f"on {task}, for any number of robots"


def _episodes(name: str, task: str) -> str:
    """Checks that the same initial states give the same returns."""
    returns = _returns(name, task)
    again = _returns(name, task)
    if not np.array_equal(returns, again):
        raise NotableError(
            "the same initial states give other returns: its evaluations can't be repeated"
        )
    mean = returns.mean()
    return f"the same initial states give the same returns; {mean:.3g} in {_STEPS} control steps"


def _returns(name: str, task: str) -> np.ndarray:
    """Returns the returns of some episodes up to a control step, or to their ends before it."""
    policy = _find(name, task)
    generators = [np.random.default_rng(seed) for seed in range(_EPISODES)]
    total = np.zeros(_EPISODES)
    with find_task(task).worlds(_EPISODES) as worlds:
        observations = worlds.reset(generators)
        policy.reset(_EPISODES)
        for _ in range(_STEPS):
            observations, rewards = worlds.step(policy.act(observations))
            total += rewards

    return total
