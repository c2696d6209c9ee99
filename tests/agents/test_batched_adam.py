"""Tests of Adam on a stack of seeds, against Adam of each seed."""

import pytest
import torch

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.tensors import SeedView, Tensors


def adam_of(view, count, random):
    """Returns parameters and their optimizer, with given parameters and gradients."""
    values, gradient = view.saved("net", count), view.scratch("net.gradient", count)
    values.copy_(random[0])
    gradient.copy_(random[1])
    return values, Adam(view, "net", values, gradient, 1e-3)


@pytest.mark.parametrize(("count", "parts"), [(16, 1), (1, 1), (30_000, 22), (97_120, 36)])
def test_stacked_adam_equals_adam_of_each_seed(count, parts):
    random = torch.randn(2, 3, count)
    stack, stacked = adam_of(SeedView(Tensors(3)), count, random)
    assert len(stacked._values) == parts
    alone = [adam_of(SeedView(Tensors(1), 0), count, random[:, seed]) for seed in range(3)]
    for _ in range(5):
        for adam in (stacked, *(adam for _, adam in alone)):
            adam.step()
    for seed, (values, _) in enumerate(alone):
        torch.testing.assert_close(stack[seed], values, rtol=0, atol=1e-7)
