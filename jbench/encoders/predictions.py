"""Probing latents: how well a small network predicts the next control step from them.

Latents may explain most of the states' variance and still miss what an agent needs. Every encoder
is therefore also evaluated by the held-out R² of a probe with fixed settings, which predicts rates
of the next state and the reward from latents and action.
"""

import itertools
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Kind, Weights
from jbench.encoders.kinds.planar import SIGNS, PlanarReduction
from jbench.encoders.scaling import Moments, physical_scaling
from jbench.encoders.states import Shard, States
from jbench.names import TASKS
from jbench.simulation import find_task

TARGETS = ("yaw_rate", "tilt_rate", "forward_speed", "reward")
"""Predicted quantities of the Jitterbug's next control step, defined in `docs/encoders.md`; of
another robot these are the change of each part of the observation, and the reward."""

_RATES = ("rate_z", "rate_x", "rate_y", "velocity_y")

# The probe has two hidden ReLU layers. Larger values of these do not change the order of kinds.
_LEARNED_ROWS, _TEST_ROWS = 60_000, 30_000
_HIDDEN, _BATCH, _EPOCHS, _RATE = 64, 512, 15, 3e-3
_SEED = 20200419

_LINEAR = 0.5  # R² from which a direction of the latents stands for a target


def predictions(kind: Kind, weights: Weights, states: States) -> list[dict[str, Any]]:
    """Trains and evaluates a probe; returns a row of `encoder_predictions` for each target."""
    inputs, targets = _rows(kind, weights, states, next(states.learn()), _LEARNED_ROWS)
    test_inputs, test_targets = _rows(kind, weights, states, next(states.test()), _TEST_ROWS)
    latents = inputs.shape[1] - states.action_size
    shared = {
        "effective_rank": effective_rank(test_inputs[:, :latents].numpy()),
        "learned_rows": len(inputs),
        "test_rows": len(test_inputs),
    }
    predicted, amplitudes = _regression(inputs, targets, test_inputs, latents)
    linear_errors = (predicted - test_targets).square().mean(0)
    linear_variance = test_targets.var(0, correction=0)
    (mean, sd), (target_mean, target_sd) = _mean_and_sd(inputs), _mean_and_sd(targets)
    probe = _trained((inputs - mean) / sd, (targets - target_mean) / target_sd)
    test_targets = (test_targets - target_mean) / target_sd
    errors = (probe((test_inputs - mean) / sd) - test_targets).square().mean(0)
    variance = test_targets.var(0, correction=0)
    rows = []
    for target, columns in _columns(states.task).items():
        linear_r2 = _r2(linear_errors[columns], linear_variance[columns])
        is_linear = linear_r2 is not None and linear_r2 >= _LINEAR
        # Standard deviation of the latents along the direction in which the regression predicts the
        # target; for several axes, of their mean square.
        amplitude = float(amplitudes[columns].square().mean().sqrt()) if is_linear else None
        r2 = _r2(errors[columns], variance[columns])
        row = {"target": target, "r2": r2, "linear_r2": linear_r2, "amplitude": amplitude}
        rows.append({**row, **shared})
    return rows


def effective_rank(rows: NDArray[np.floating]) -> float:
    """Returns exp of the entropy of the singular values (Roy and Vetterli, 2007); 0 if constant."""
    centered = rows.astype(np.float64) - rows.mean(0, dtype=np.float64)
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(centered.T @ centered), 0))
    if not singular.sum():
        return 0.0
    shares = singular / singular.sum()
    shares = shares[shares > 0]
    return float(np.exp(-(shares * np.log(shares)).sum()))


def _columns(task: str) -> dict[str, list[int]]:
    if task in TASKS:
        return dict(zip(TARGETS, ([0], [1, 2], [3], [4]), strict=True))
    sizes = {**find_task(task).parts, "reward": 1}
    ends = itertools.accumulate(sizes.values())
    return {n: list(range(end - sizes[n], end)) for n, end in zip(sizes, ends, strict=True)}


def _rows(
    kind: Kind, weights: Weights, states: States, shard: Shard, max_rows: int
) -> tuple[Tensor, Tensor]:
    """Returns inputs (rows, latents + action_size) and targets (rows, columns) of random pairs."""
    shard = shard.to(torch.device("cpu"))
    order = torch.randperm(shard.pairs(1), generator=torch.Generator().manual_seed(_SEED))
    batch = shard.take(order[:max_rows], 1, with_actions=True)
    latents = np.asarray(kind.to_latents(weights, batch.now.numpy()), np.float32)
    if states.task not in TASKS:
        changes = torch.cat([batch.later - batch.now, batch.rewards], 1)
        return torch.cat([torch.from_numpy(latents), batch.actions], 1), changes
    gain, offset = physical_scaling(states.task, states.scaling)
    physical = batch.later.double().numpy() * gain + offset
    later = PlanarReduction().numbers(states.task, physical)
    # In the heading frame the robot faces -y.
    rates = np.stack([later[name] for name in _RATES], axis=1) * (1, 1, 1, -1)
    actions = batch.actions.numpy()
    signs = kind.action_signs(weights, batch.now.numpy())
    if signs is not None:  # these latents are predicted what the mirrored robot does
        mirror = [SIGNS[name] for name in _RATES]
        actions, rates = actions * signs, np.where(signs < 0, rates * mirror, rates)
    targets = np.concatenate([rates, batch.rewards.numpy()], axis=1).astype(np.float32)
    inputs = np.concatenate([latents, actions], axis=1)
    return torch.from_numpy(inputs), torch.from_numpy(targets)


def _regression(
    inputs: Tensor, targets: Tensor, test_inputs: Tensor, latents: int
) -> tuple[Tensor, Tensor]:
    """Returns predictions (rows, columns) of a linear regression, and its amplitudes (columns,)."""
    moments = Moments.of(torch.cat([inputs.double(), targets.double()], 1).numpy())
    slopes, offset = moments.regression(inputs.shape[1])
    along, covariance = slopes[:latents], moments.covariance[:latents, :latents]
    sd = np.sqrt(np.maximum(np.einsum("it,ij,jt->t", along, covariance, along), 0))
    norms = np.linalg.norm(along, axis=0)
    amplitudes = np.divide(sd, norms, out=np.zeros_like(sd), where=norms > 0)
    predicted = test_inputs.double() @ torch.from_numpy(slopes) + torch.from_numpy(offset)
    return predicted, torch.from_numpy(amplitudes)


def _mean_and_sd(rows: Tensor) -> tuple[Tensor, Tensor]:
    sd = rows.std(0)
    return rows.mean(0), torch.where(sd > 1e-6, sd, 1)


def _r2(errors: Tensor, variance: Tensor) -> float | None:
    total = float(variance.sum())
    return 1 - float(errors.sum()) / total if total > 0 else None


def _trained(inputs: Tensor, targets: Tensor) -> torch.nn.Module:
    random = torch.Generator().manual_seed(_SEED)
    sizes = (inputs.shape[1], _HIDDEN, _HIDDEN, targets.shape[1])
    linear = [torch.nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
    for layer in linear:
        torch.nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=random)
        torch.nn.init.zeros_(layer.bias)
    relu = torch.nn.ReLU()
    network = torch.nn.Sequential(linear[0], relu, linear[1], relu, linear[2])
    steps = _EPOCHS * -(-len(inputs) // _BATCH)
    adam = torch.optim.Adam(network.parameters(), lr=_RATE, fused=True)
    scheduler = torch.optim.lr_scheduler.LinearLR(adam, 1, 0.01, total_iters=steps)
    for _ in range(_EPOCHS):
        order = torch.randperm(len(inputs), generator=random)
        for indices in order.split(_BATCH):
            loss = torch.nn.functional.mse_loss(network(inputs[indices]), targets[indices])
            adam.zero_grad()
            loss.backward()
            adam.step()
            scheduler.step()
    return network.requires_grad_(requires_grad=False)
