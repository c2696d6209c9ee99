"""What the tests of experiments share."""

import functools

import pytest

from jbench.experiments import batch, evaluator, settings


@pytest.fixture(autouse=True)
def _one_thread(one_thread):
    """Every test of these learns."""


@pytest.fixture
def short_episodes(monkeypatch):
    """Makes the batched engine's episodes 50 control steps long."""
    for module in (batch, evaluator, settings):
        monkeypatch.setattr(module, "EPISODE_STEPS", 50)
    shorter = functools.partial(batch.make_engine, episode_steps=50)
    monkeypatch.setattr(batch, "make_engine", shorter)
