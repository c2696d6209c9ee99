"""Fixtures of the tests of agents."""

import pytest


@pytest.fixture(autouse=True)
def _one_thread(one_thread):
    """Runs each of these tests on one thread."""
