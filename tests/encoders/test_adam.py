"""Tests of Adam, bit for bit against that of PyTorch."""

import torch

from jbench.encoders.adam import FusedAdam


def test_steps_equal_those_of_pytorch_with_a_rate_that_falls():
    random = torch.Generator().manual_seed(0)
    shapes, steps, last = ((5, 3), (7,)), 20, 0.01
    theirs = [torch.randn(shape, generator=random).requires_grad_() for shape in shapes]
    ours = [value.detach().clone() for value in theirs]
    reference = torch.optim.Adam(theirs, lr=3e-3, fused=True)
    scheduler = torch.optim.lr_scheduler.LinearLR(reference, 1, last, total_iters=steps)
    adam = FusedAdam(ours, 3e-3)
    for step in range(steps):
        gradients = [torch.randn(shape, generator=random) for shape in shapes]
        for value, gradient in zip(theirs, gradients, strict=True):
            value.grad = gradient
        reference.step()
        scheduler.step()
        adam.step(gradients)
        adam.learning_rate *= 1 + (last - 1) / (steps + step * (last - 1))
        for value, other in zip(ours, theirs, strict=True):
            assert torch.equal(value, other)
