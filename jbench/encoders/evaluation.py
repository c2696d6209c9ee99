"""What latents explain and predict: the rows of an encoder's tables.

Reconstruction errors are those on held-out episodes and on episodes of the heuristic. PCA and a
random projection of the same size, fitted to the same states, are evaluated for comparison.

Latents may explain most of the states' variance and still miss what an agent needs. Every encoder
is therefore also evaluated by the held-out R² of a probe with fixed settings: a small network that
predicts rates of the next state and the reward from latents and action.
"""

import itertools
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.adam import FusedAdam
from jbench.encoders.kind import Fitted, Kind, Weights
from jbench.encoders.kinds.linear import PrincipalComponents, RandomProjection
from jbench.encoders.kinds.planar import SIGNS, PlanarReduction
from jbench.encoders.pairs import Shard, state_pairs
from jbench.encoders.scaling import FloatArray, Moments
from jbench.encoders.states import States
from jbench.tasks.find import find_task
from jbench.tasks.task import episode_generator, rollout

_EPISODES = 10  # of the heuristic
_SEED = 20200419  # not used by `jbench evaluate` or for tuning the heuristics

_BASELINES: dict[str, Fitted] = {"pca": PrincipalComponents(), "random": RandomProjection()}

TARGETS = ("yaw_rate", "tilt_rate", "forward_speed", "reward")
"""Predicted quantities of the Jitterbug's next control step, defined in `docs/encoders.md`; of
another robot these are the change of each part of the observation, and the reward."""

_RATES = ("rate_z", "rate_x", "rate_y", "velocity_y")

# The probe has two hidden ReLU layers. Larger values of these do not change the order of kinds.
_LEARNED_ROWS = 60_000
_TEST_ROWS = 30_000
_HIDDEN = 64
_BATCH = 512
_EPOCHS = 15
_RATE = 3e-3
_LAST = 0.01  # of the learning rate, at the end

_LINEAR = 0.5  # R² from which a direction of the latents stands for a target


def errors(
    kind: Kind, weights: Mapping[str, Any], latents: int, states: States
) -> dict[str, list[dict[str, Any]]]:
    """Returns the rows of `encoder_features` and `encoder_errors`, without the encoder.

    They are errors on held-out episodes, `test`, and on those of the hand-written policy,
    `heuristic`, which other robots do not have.
    """
    data: dict[str, tuple[Iterable[Shard], Moments]] = {"test": (states.test(), states.held_out)}
    if find_task(states.task).hand_written() is not None:
        scaled = states.scaled(heuristic_episodes(states.task, states.dataset.settings.augment))
        unused = torch.empty(0)  # actions and rewards
        shard = Shard(torch.from_numpy(scaled), unused, unused).to(states.device)
        data["heuristic"] = [shard], Moments.of(scaled)

    on_device = {name: torch.from_numpy(value).to(states.device) for name, value in weights.items()}
    size = min(latents, states.size)  # there may be more latents than features
    baselines = {name: (other, other.fit(states, size)) for name, other in _BASELINES.items()}
    columns: dict[str, FloatArray] = {}
    totals: dict[str, Any] = {}

    for episodes, (shards, moments) in data.items():
        mse, variance = reconstruction_errors(kind, on_device, shards)
        end = "" if episodes == "test" else f"_{episodes}"
        mses = {episodes: mse} | {
            f"{name}{end}": affine_errors(*fitted, moments) for name, fitted in baselines.items()
        }
        for name, error in mses.items():
            columns[f"{name}_mse"] = error

        columns[f"{episodes}_variance"] = variance
        totals[f"{episodes}_states"] = moments.rows
        total = variance.sum()

        for name, error in mses.items():
            totals[f"{name}_explained"] = float(1 - error.sum() / total) if total else 0.0

    for name, values in columns.items():
        totals[name] = float(values.mean())

    features = [
        {
            "index": states.columns[i],
            "feature": label,
            **{name: values[i] for name, values in columns.items()},
        }
        for i, label in enumerate(states.labels)
    ]
    return {"encoder_features": features, "encoder_errors": [totals]}


@torch.no_grad()
def reconstruction_errors(
    kind: Kind, weights: Mapping[str, Tensor], shards: Iterable[Shard]
) -> tuple[FloatArray, FloatArray]:
    """Returns the (size,) mean squared errors of a kind and the variances of its targets."""
    sums: Any = 0
    count = 0
    for batch in state_pairs(shards, kind.steps_ahead if kind.decodes_later else 0):
        target = batch.later.double()
        error = kind.from_latents(weights, kind.to_latents(weights, batch.now)) - batch.later
        summed = (error.double().square(), target, target.square())
        sums = sums + torch.stack([values.sum(0) for values in summed]).cpu().numpy()
        count += len(batch.now)

    mse, mean, square = sums / count
    return mse, np.maximum(square - mean**2, 0)


@cache
def heuristic_episodes(task: str, augment: int | None) -> NDArray[np.float32]:
    """Returns (10, 1001, size) observations of the heuristic."""
    generators = [episode_generator(_SEED, episode) for episode in range(_EPISODES)]
    policy = find_task(task).hand_written()
    assert policy is not None
    policy.reset(_EPISODES)
    with find_task(task).worlds(_EPISODES, threads=2, augment=augment) as worlds:
        first = worlds.reset(generators)
        steps = rollout(worlds, first, lambda seen: policy.act(seen).astype(np.float32))
        return np.stack([first, *(step.next_observations for step in steps)], axis=1)


def affine_errors(kind: Kind, weights: Mapping[str, FloatArray], moments: Moments) -> FloatArray:
    """Returns the (size,) mean squared errors of an affine kind, which follow from the moments."""
    identity = np.eye(len(moments.mean))
    shift = kind.decode(weights, kind.encode(weights, np.zeros_like(moments.mean)))
    matrix = (kind.decode(weights, kind.encode(weights, identity)) - shift).T
    difference = matrix - identity
    bias = difference @ moments.mean + shift
    variance = np.einsum("ij,jk,ik->i", difference, moments.covariance, difference)
    return np.asarray(np.maximum(variance + bias**2, 0))


def predictions(kind: Kind, weights: Weights, states: States) -> list[dict[str, Any]]:
    """Trains and evaluates a probe; returns a row of `encoder_predictions` for each target."""
    whole = states.whole
    inputs, targets = _rows(kind, weights, states, next(whole.learn()), _LEARNED_ROWS)
    test_inputs, test_targets = _rows(kind, weights, states, next(whole.test()), _TEST_ROWS)
    latents = inputs.shape[1] - states.action_size
    shared = {
        "effective_rank": effective_rank(test_inputs[:, :latents].numpy()),
        "learned_rows": len(inputs),
        "test_rows": len(test_inputs),
    }
    if find_task(states.task).has_planar_reduction:
        columns = dict(zip(TARGETS, ([0], [1, 2], [3], [4]), strict=True))
    else:
        sizes = {**find_task(states.task).parts, "reward": 1}
        ends = zip(sizes, itertools.accumulate(sizes.values()), strict=True)
        columns = {name: list(range(end - sizes[name], end)) for name, end in ends}

    moments = Moments.of(torch.cat([inputs.double(), targets.double()], 1).numpy())
    slopes, offset = moments.regression(inputs.shape[1])
    predicted = test_inputs.double() @ torch.from_numpy(slopes) + torch.from_numpy(offset)
    linear_r2 = _r2(predicted, test_targets, columns)

    probe = _trained(_standardized(inputs, inputs), _standardized(targets, targets))
    predicted = probe(_standardized(test_inputs, inputs))
    r2 = _r2(predicted, _standardized(test_targets, targets), columns)

    # Standard deviations of the latents along the directions in which the regression predicts; of a
    # target with several axes, the root of their mean square.
    along = slopes[:latents]
    covariance = moments.covariance[:latents, :latents]
    sd = np.sqrt(np.maximum(np.einsum("it,ij,jt->t", along, covariance, along), 0))
    norms = np.linalg.norm(along, axis=0)
    amplitudes = torch.from_numpy(np.divide(sd, norms, out=np.zeros_like(sd), where=norms > 0))

    rows = []
    for target, some in columns.items():
        row = {"target": target, "r2": r2[target], "linear_r2": linear_r2[target]}
        is_linear = (linear_r2[target] or 0) >= _LINEAR
        row["amplitude"] = float(amplitudes[some].square().mean().sqrt()) if is_linear else None
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


def _rows(
    kind: Kind, weights: Weights, states: States, shard: Shard, max_rows: int
) -> tuple[Tensor, Tensor]:
    """Returns inputs (rows, latents + action_size) and targets (rows, columns) of random pairs.

    The shard has all features: an encoder of some is evaluated by the same targets.
    """
    shard = shard.to(torch.device("cpu"))
    order = torch.randperm(shard.pairs(1), generator=torch.Generator().manual_seed(_SEED))
    batch = shard.take(order[:max_rows], 1, with_actions=True)
    observed = batch.now[:, states.columns].numpy()
    latents = np.asarray(kind.to_latents(weights, observed), np.float32)
    if not find_task(states.task).has_planar_reduction:
        changes = torch.cat([batch.later - batch.now, batch.rewards], 1)
        return torch.cat([torch.from_numpy(latents), batch.actions], 1), changes

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
    inputs = np.concatenate([latents, actions], axis=1)
    return torch.from_numpy(inputs), torch.from_numpy(targets)


def _standardized(rows: Tensor, like: Tensor) -> Tensor:
    """Returns rows shifted and scaled such that those of `like` have mean 0 and unit variance."""
    sd = like.std(0)
    return (rows - like.mean(0)) / torch.where(sd > 1e-6, sd, 1)


def _r2(
    predicted: Tensor, targets: Tensor, columns: Mapping[str, list[int]]
) -> dict[str, float | None]:
    """Returns the R² of each target, which has some of the columns; None if it is constant."""
    squares = (predicted - targets).square().mean(0)
    variance = targets.var(0, correction=0)
    totals = {name: float(variance[some].sum()) for name, some in columns.items()}
    return {
        name: 1 - float(squares[columns[name]].sum()) / total if total > 0 else None
        for name, total in totals.items()
    }


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
