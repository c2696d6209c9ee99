"""What the tests of experiments share."""

import pytest

from tests.training.small_runs import shorten_episodes


@pytest.fixture(autouse=True)
def _one_thread(one_thread):
    """Every test of these learns."""


@pytest.fixture
def short_episodes(monkeypatch):
    """Makes the batched engine's episodes 50 control steps long."""
    shorten_episodes(monkeypatch.setattr)
