"""Shorter evaluations of encoders, on two episodes of the hand-written policy instead of ten."""

from contextlib import contextmanager
from functools import cache
from unittest import mock

from jbench import task_specs
from jbench.encoders import reconstruction

EPISODES = 2

_episodes = reconstruction.heuristic_episodes.__wrapped__


@cache
def cached(task, augment, _length):
    return _episodes(task, augment)


def two_episodes(task, augment):
    """Returns the same as `heuristic_episodes`, whose own cache keeps all ten episodes."""
    return cached(task, augment, task_specs.EPISODE_STEPS)


@contextmanager
def short_encoder_evaluation():
    """Evaluates encoders on two episodes within a block, such as that of a fixture."""
    with (
        mock.patch.object(reconstruction, "_EPISODES", EPISODES),
        mock.patch.object(reconstruction, "heuristic_episodes", two_episodes),
    ):
        yield
