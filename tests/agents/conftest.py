"""What the tests of agents share."""

import pytest
import torch


@pytest.fixture(autouse=True)
def one_thread():
    """Keeps torch to one thread: a machine that is busy waits for the second one longest."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
