"""Checks of tasks of others: an episode, seeds, several worlds at once, speed."""

import time
from collections.abc import Iterator
from functools import partial

import numpy as np

from jbench.checks.checked import NamedCheck, NotableError
from jbench.errors import WorkError
from jbench.tasks.find import checked_task, find_task

_STEPS = 100
_SLOW = 5e-3  # seconds of a control step


def checks(name: str) -> Iterator[NamedCheck]:
    """Yields the checks of a task."""
    yield "made", partial(_made, name)
    yield "episode", partial(_episode, name)
    yield "seeds", partial(_seeds, name)
    yield "side by side", partial(_side_by_side, name)
    yield "again", partial(_again, name)
    yield "speed", partial(_speed, name)


def _made(name: str) -> str:
    """Makes the task and says its sizes."""
    task = find_task(name)
    return f"observations of {task.observation_size} and actions of {task.action_size}"


def _episode(name: str) -> str:
    """Steps an episode, as jbench does before each training."""
    task = checked_task(name)
    return f"an episode of random actions has {task.length_in_words}, its sizes and finite rewards"


def _seen(name: str, seed: int, count: int = 1) -> np.ndarray:
    """Returns the observations (steps, size) of the first of some worlds."""
    task = find_task(name)
    random = np.random.default_rng(7)
    with task.worlds(count) as worlds:
        generators = [np.random.default_rng(seed + i) for i in range(count)]
        rows = [worlds.reset(generators)[0].copy()]
        for _ in range(_STEPS):
            actions = np.tile(random.uniform(-1, 1, task.action_size), (count, 1))
            rows.append(worlds.step(actions)[0][0].copy())

    return np.stack(rows)


def _seeds(name: str) -> str:
    """Checks that the seed, and only the seed, decides an episode."""
    first, again, other = (_seen(name, seed) for seed in (0, 0, 1))
    if not np.array_equal(first, again):
        raise WorkError(
            "the same seed and actions give other observations: draw all random numbers from the "
            "seed, and keep nothing from one environment to the next."
        )

    if np.array_equal(first, other):
        raise NotableError("every seed begins with the same state")

    return "the same seed gives the same episode, another seed another one"


def _side_by_side(name: str) -> str:
    """Checks that environments do not depend on each other."""
    if not np.array_equal(_seen(name, 0), _seen(name, 0, count=3)):
        raise WorkError("an environment's numbers depend on others that are stepped beside it.")
    return "environments side by side do not depend on each other"


def _again(name: str) -> str:
    """A resumed run begins the episode again from the state between two episodes."""
    task = find_task(name)
    with task.worlds(1) as worlds:
        first = worlds.reset([np.random.default_rng(3)]).copy()
        state = worlds.state(slice(0, 1))
        again = worlds.restore(slice(0, 1), state)
        if not np.array_equal(first, again):
            raise WorkError("an episode that is begun again from its seed begins differently.")
    return "an episode begins again from its seed, as when a run resumes"


def _speed(name: str) -> str:
    """Measures a control step."""
    task = find_task(name)
    with task.worlds(1) as worlds:
        worlds.reset([np.random.default_rng(0)])
        began = time.perf_counter()
        for _ in range(_STEPS):
            worlds.step(np.zeros((1, task.action_size)))
            if worlds.are_over():
                worlds.reset([np.random.default_rng(0)])
        seconds = (time.perf_counter() - began) / _STEPS

    text = f"{1e3 * seconds:.2f} ms per control step"
    if seconds > _SLOW:
        raise NotableError(f"{text}: a million control steps take {seconds * 1e6 / 3600:.1f} h")

    return text
