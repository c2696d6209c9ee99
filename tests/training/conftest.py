"""Fixtures of the training tests."""

import pytest

from tests.short_episodes import short_episodes


@pytest.fixture(scope="module", name="short_episodes")
def _short_episodes():
    """Makes the episodes of all tests of a file 50 control steps long."""
    with short_episodes():
        yield
