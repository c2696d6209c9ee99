"""Tests of networks in bfloat16; `test_plain_updates.py` has gradients in full precision."""

import pytest
import torch
from torch import nn

from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.tensors import Tensors


def build_network(low_precision=False):
    """A network with random parameters, and three actions among its inputs."""
    view = Tensors(1, low_precision=low_precision).select(0)
    layout = Layout((17, 64, 48, 1), 3)
    values, gradient = (
        f(name, layout.length) for f, name in ((view.state, "values"), (view.scratch, "gradient"))
    )
    random = torch.Generator().manual_seed(0)
    network = Network(view, layout, values, gradient, workspace="workspace")
    for weight, bias in network.layers:
        for parameters in (weight, bias):
            nn.init.normal_(parameters, 0, 0.3, generator=random)
    return network


def test_low_precision_rounds_to_bfloat16():
    exact = build_network()
    rough = build_network(low_precision=True)
    random = torch.Generator().manual_seed(1)
    inputs, delta = (torch.randn(100, size, generator=random) for size in (17, 1))
    assert not torch.equal(exact.forward(inputs), rough.forward(inputs))
    torch.testing.assert_close(rough.forward(inputs), exact.forward(inputs), rtol=0, atol=0.05)
    for network in (exact, rough):
        network.forward(inputs)
        network.backward(delta)
    error = (exact.gradient - rough.gradient).norm() / exact.gradient.norm()
    # Rounding to 8 bits is 0.4%, and it switches a few ReLU units.
    assert 1e-5 < error < 0.05


@pytest.mark.parametrize("rows", [1, 5, 31, 33, 100])
def test_low_precision_gradients_of_selected_rows_are_equal(rows):
    network = build_network(low_precision=True)
    random = torch.Generator().manual_seed(1)
    inputs, delta = (torch.randn(100, size, generator=random) for size in (17, 1))
    network.forward(inputs)
    expected = network.action_gradient(delta)
    indices = torch.randperm(100, generator=random)[:rows]
    gradient = network.action_gradient(delta[indices], indices)
    torch.testing.assert_close(gradient, expected[indices], rtol=0.02, atol=1e-3)
