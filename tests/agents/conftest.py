"""What the tests of agents share."""

import pytest


@pytest.fixture(autouse=True)
def _one_thread(one_thread):
    """Every test of these learns."""
