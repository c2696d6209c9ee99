"""Fixtures of the training tests."""

import pytest

from tests.training.small_runs import shorten_episodes


@pytest.fixture(scope="module")
def short_episodes():
    """Makes the episodes of all tests of a file 50 control steps long."""
    with pytest.MonkeyPatch.context() as patch:
        shorten_episodes(patch.setattr)
        yield
