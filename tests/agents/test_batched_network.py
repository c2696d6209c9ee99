"""Tests of networks with hand-written gradients, against autograd."""

import pytest
import torch
from torch import nn

from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.tensors import Tensors

SIZES = [(5, 1), (5, 20, 1), (17, 24, 20, 1), (16, 9, 33, 16, 2)]
# Each layer at which the last inputs can be appended.
JOINED = [(sizes, joins) for sizes in SIZES for joins in range(len(sizes) - 1)]
ACTIONS = 3


def network_of(sizes, dtype=torch.float64, seeds=None, joins=0, low_precision=False):
    """A network with random parameters, of one seed or of a stack."""
    tensors = Tensors(seeds or 1, dtype, low_precision=low_precision)
    view = tensors if seeds else tensors.select(0)
    layout = Layout(sizes, ACTIONS, joins)
    values, gradient = (
        f(name, layout.length) for f, name in ((view.state, "values"), (view.scratch, "gradient"))
    )
    random = torch.Generator().manual_seed(0)
    network = Network(view, layout, values, gradient, workspace="workspace")
    for weight, bias in network.layers:
        for parameters in (weight, bias):
            nn.init.normal_(parameters, 0, 0.3, generator=random)
    return network


def in_torch(network, inputs):
    """Returns outputs computed by torch, and the parameters as leaves of the graph."""
    leaves = [
        [parameters.clone().requires_grad_() for parameters in affine] for affine in network.layers
    ]
    values, last = inputs[..., :-ACTIONS], inputs[..., -ACTIONS:]
    for i, (weight, bias) in enumerate(leaves):
        if i > 0:
            values = values.relu()
        if i == network.layout.joins:
            values = torch.cat([values, last], dim=-1)
        values = values @ weight + bias.unsqueeze(-2)
    return values, leaves


@pytest.mark.parametrize("seeds", [None, 3])
@pytest.mark.parametrize(("sizes", "joins"), JOINED)
def test_gradients_equal_autograd(sizes, joins, seeds):
    network = network_of(sizes, seeds=seeds, joins=joins)
    batch_shape = (seeds,) if seeds else ()
    inputs = torch.randn(*batch_shape, 30, sizes[0], dtype=torch.float64, requires_grad=True)
    delta = torch.randn(*batch_shape, 30, sizes[-1], dtype=torch.float64)
    outputs, leaves = in_torch(network, inputs)
    outputs.backward(delta)
    plain = inputs.detach()
    torch.testing.assert_close(network.forward(plain), outputs.detach())
    network.backward(delta)
    for ours, theirs in zip(network.layout.views(network.gradient), leaves, strict=True):
        for gradient, leaf in zip(ours, theirs, strict=True):
            torch.testing.assert_close(gradient, leaf.grad)
    network.forward(plain)
    torch.testing.assert_close(network.action_gradient(delta), inputs.grad[..., -ACTIONS:])


@pytest.mark.parametrize("joins", [0, 1, 3])
def test_padding_stays_zero(joins):
    network = network_of((16, 9, 33, 16, 2), joins=joins)
    network.forward(torch.randn(8, 16, dtype=torch.float64))
    network.backward(torch.randn(8, 2, dtype=torch.float64))
    for flat in (network.values, network.gradient):
        rest = flat.clone()
        for affine in network.layout.views(rest):
            for parameters in affine:
                parameters.zero_()
        assert not rest.any()
    real = sum(parameters.numel() for affine in network.layers for parameters in affine)
    assert network.values.numel() > real


def test_each_batch_size_has_its_own_buffers():
    network = network_of((5, 20, 1))
    large, small = torch.randn(9, 5, dtype=torch.float64), torch.randn(2, 5, dtype=torch.float64)
    first = network.forward(large).clone()
    network.forward(small)
    assert torch.equal(network.forward(large), first)


def test_low_precision_rounds_to_bfloat16():
    exact = network_of((17, 64, 48, 1), torch.float32)
    rough = network_of((17, 64, 48, 1), torch.float32, low_precision=True)
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
    network = network_of((17, 64, 48, 1), torch.float32, low_precision=True)
    random = torch.Generator().manual_seed(1)
    inputs, delta = (torch.randn(100, size, generator=random) for size in (17, 1))
    network.forward(inputs)
    expected = network.action_gradient(delta)
    indices = torch.randperm(100, generator=random)[:rows]
    gradient = network.action_gradient(delta[indices], indices)
    torch.testing.assert_close(gradient, expected[indices], rtol=0.02, atol=1e-3)
