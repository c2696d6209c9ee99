"""Fixtures of the training tests."""

import pytest

from tests.training.small_runs import shorten_episodes


@pytest.fixture
def short_episodes(monkeypatch):
    """Makes the batched engine's episodes 50 control steps long."""
    shorten_episodes(monkeypatch.setattr)
