"""What latents predict: the rows of an encoder's table `encoder_predictions`.

Latents may explain most of the states' variance and still miss what an agent needs. Every encoder
is therefore evaluated by the held-out R² of a probe with fixed settings: a small network that
predicts rates of the next state and the reward from latents and action. A linear regression on the
same rows is evaluated beside it.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.array_types import FloatArray
from jbench.encoders.adam import FusedAdam
from jbench.encoders.kind import Kind
from jbench.encoders.kinds.planar import SIGNS, PlanarReduction
from jbench.encoders.networks import Weights
from jbench.encoders.pairs import Shard
from jbench.encoders.scaling import Moments
from jbench.encoders.states import States
from jbench.tasks.find import find_task

TARGETS = ("yaw_rate", "tilt_rate", "forward_speed", "reward")
"""Predicted quantities of the Jitterbug's next control step, defined in `docs/encoders.md`; of
another robot these are the change of each part of the observation, and the reward."""

_COLUMNS = ([0], [1, 2], [3], [4])  # of each of `TARGETS`
_RATES = ("rate_z", "rate_x", "rate_y", "velocity_y")  # planar numbers in the first four columns

_SEED = 20200419

# The probe has two hidden ReLU layers. Larger values of these do not change the order of kinds.
_LEARNED_ROWS = 60_000
_TEST_ROWS = 30_000
_HIDDEN = 64
_BATCH = 512
_EPOCHS = 15
_RATE = 3e-3
_LAST = 0.01  # of the learning rate, at the end

_CONSTANT = 1e-6
"""Largest standard deviation of a column that counts as constant: the change of a step counter is
constant up to its rounding in float32, some 1e-7."""

_LINEAR = 0.5  # R² from which a direction of the latents stands for a target


@dataclass(frozen=True)
class _Examples:
    """Rows from which a probe learns, or by which it is tested.

    Attributes:
        inputs: (rows, latents + action_size) latents and action before a control step.
        targets: (rows, columns) what the step leads to, one or more columns for each target.
    """

    inputs: Tensor
    targets: Tensor


def predictions(kind: Kind, weights: Weights, states: States) -> list[dict[str, Any]]:
    """Trains and evaluates a probe; returns a row of `encoder_predictions` for each target.

    The rows are of the first shard of the training and of the held-out episodes: of a dataset whose
    states do not fit in memory, that is a part of it.
    """
    whole = states.whole
    learned = _examples(kind, weights, states, next(whole.learn()), _LEARNED_ROWS)
    test = _examples(kind, weights, states, next(whole.test()), _TEST_ROWS)
    columns = _target_columns(states.task)

    moments = Moments.of(torch.cat([learned.inputs.double(), learned.targets.double()], 1).numpy())
    slopes, offset = moments.regression(learned.inputs.shape[1])
    predicted = test.inputs.double() @ torch.from_numpy(slopes) + torch.from_numpy(offset)
    varying = _varying(learned.targets) & _varying(test.targets)
    linear_r2 = _r2(predicted, test.targets, columns, varying)

    probe = _trained(
        _standardized(learned.inputs, like=learned.inputs),
        _standardized(learned.targets, like=learned.targets),
    )
    predicted = probe(_standardized(test.inputs, like=learned.inputs))
    r2 = _r2(predicted, _standardized(test.targets, like=learned.targets), columns, varying)

    latents = learned.inputs.shape[1] - states.action_size
    amplitudes = _amplitudes(slopes[:latents], moments.covariance[:latents, :latents])
    rank = effective_rank(test.inputs[:, :latents].numpy())

    rows = []
    for target, some in columns.items():
        amplitude = None
        if (linear_r2[target] or 0) >= _LINEAR:
            amplitude = float(amplitudes[some].square().mean().sqrt())

        rows.append(
            {
                "target": target,
                "r2": r2[target],
                "linear_r2": linear_r2[target],
                "amplitude": amplitude,
                "effective_rank": rank,
                "learned_rows": len(learned.inputs),
                "test_rows": len(test.inputs),
            }
        )

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


def _target_columns(task: str) -> dict[str, list[int]]:
    """Returns which columns of `_Examples.targets` each target of a task has."""
    found = find_task(task)
    if found.has_planar_reduction:
        return dict(zip(TARGETS, _COLUMNS, strict=True))

    columns = {}
    first = 0
    for name, size in {**found.parts, "reward": 1}.items():
        columns[name] = list(range(first, first + size))
        first += size

    return columns


def _examples(
    kind: Kind, weights: Weights, states: States, shard: Shard, max_rows: int
) -> _Examples:
    """Returns random control steps of episodes.

    The shard has all features: an encoder of some is evaluated by the same targets.
    """
    shard = shard.to(torch.device("cpu"))
    order = torch.randperm(shard.pairs(1), generator=torch.Generator().manual_seed(_SEED))
    batch = shard.take(order[:max_rows], 1, with_actions=True)
    observed = batch.now[:, states.columns].numpy()
    latents = np.asarray(kind.to_latents(weights, observed), np.float32)
    if not find_task(states.task).has_planar_reduction:
        changes = torch.cat([batch.later - batch.now, batch.rewards], 1)
        inputs = torch.cat([torch.from_numpy(latents), batch.actions], 1)
        return _Examples(inputs, changes)

    gain, offset = states.whole.physical_scaling()
    physical = batch.later.double().numpy() * gain + offset
    later = PlanarReduction().numbers(states.task, physical)
    # In the heading frame the robot faces -y.
    rates = np.stack([later[name] for name in _RATES], axis=1) * (1, 1, 1, -1)
    actions = batch.actions.numpy()
    signs = kind.action_signs(weights, observed)
    if signs is not None:  # these latents are predicted what the mirrored robot does
        mirror = [SIGNS[name] for name in _RATES]
        actions = actions * signs
        rates = np.where(signs < 0, rates * mirror, rates)

    targets = np.concatenate([rates, batch.rewards.numpy()], axis=1).astype(np.float32)
    inputs = torch.from_numpy(np.concatenate([latents, actions], axis=1))
    return _Examples(inputs, torch.from_numpy(targets))


def _standardized(rows: Tensor, like: Tensor) -> Tensor:
    """Returns rows shifted and scaled such that those of `like` have mean 0 and unit variance.

    Columns that are constant in `like` are only shifted.
    """
    return (rows - like.mean(0)) / torch.where(_varying(like), like.std(0), 1)


def _varying(rows: Tensor) -> Tensor:
    """Returns whether each column (columns,) is not constant."""
    return rows.std(0) > _CONSTANT


def _r2(
    predicted: Tensor, targets: Tensor, columns: Mapping[str, list[int]], varying: Tensor
) -> dict[str, float | None]:
    """Returns the R² of each target, which has some of the columns; None if all are constant."""
    squares = (predicted - targets).square().mean(0)
    variance = targets.var(0, correction=0)
    r2: dict[str, float | None] = dict.fromkeys(columns)
    for name, some in columns.items():
        if bool(varying[some].any()):
            total = float(variance[some].sum())
            r2[name] = 1 - float(squares[some].sum()) / total

    return r2


def _amplitudes(slopes: FloatArray, covariance: FloatArray) -> Tensor:
    """Returns standard deviations of latents along the directions in which a regression predicts.

    Args:
        slopes: (latents, columns) of the regression.
        covariance: (latents, latents) of the latents.

    Returns:
        (columns,) numbers, 0 where no latent has a slope. The amplitude of a target with several
        columns is the root of their mean square.
    """
    variances = np.einsum("it,ij,jt->t", slopes, covariance, slopes)
    sd = np.sqrt(np.maximum(variances, 0))
    norms = np.linalg.norm(slopes, axis=0)
    return torch.from_numpy(np.divide(sd, norms, out=np.zeros_like(sd), where=norms > 0))


def _trained(inputs: Tensor, targets: Tensor) -> torch.nn.Module:
    """Returns a network that was trained to predict targets (rows, columns) of inputs."""
    random = torch.Generator().manual_seed(_SEED)
    sizes = (inputs.shape[1], _HIDDEN, _HIDDEN, targets.shape[1])
    linear = [torch.nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
    for layer in linear:
        torch.nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=random)
        torch.nn.init.zeros_(layer.bias)

    relu = torch.nn.ReLU()
    network = torch.nn.Sequential(linear[0], relu, linear[1], relu, linear[2])
    steps = _EPOCHS * -(-len(inputs) // _BATCH)
    parameters = list(network.parameters())
    adam = FusedAdam(parameters, _RATE)
    step = 0

    for _ in range(_EPOCHS):
        order = torch.randperm(len(inputs), generator=random)
        for indices in order.split(_BATCH):
            loss = torch.nn.functional.mse_loss(network(inputs[indices]), targets[indices])
            adam.step(torch.autograd.grad(loss, parameters))
            # The rate falls in a line.
            adam.learning_rate *= 1 + (_LAST - 1) / (steps + step * (_LAST - 1))
            step += 1

    return network.requires_grad_(requires_grad=False)
