"""How well latents explain states: the rows of an encoder's tables of errors.

Errors are those on held-out episodes and on episodes of the hand-written policy. PCA and a random
projection of the same size, fitted to the same states, are evaluated for comparison.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.array_types import FloatArray
from jbench.encoders.kind import Fitted, Kind
from jbench.encoders.kinds.linear import PrincipalComponents, RandomProjection
from jbench.encoders.pairs import Shard, state_pairs
from jbench.encoders.scaling import Moments
from jbench.encoders.states import States
from jbench.tasks.find import find_task
from jbench.tasks.task import episode_generator, rollout

_EPISODES = 10  # of the hand-written policy
_SEED = 20200419  # not used by `jbench evaluate` or for tuning the hand-written policies

_BASELINES: dict[str, Fitted] = {"pca": PrincipalComponents(), "random": RandomProjection()}


class _Evaluated(NamedTuple):
    """Scaled states by which an encoder is evaluated, and their moments."""

    shards: Iterable[Shard]
    moments: Moments


class _Errors(NamedTuple):
    """Mean squared errors of the reconstruction of states, and what they are compared with."""

    mse: FloatArray  # (size,) of the features
    variance: FloatArray  # (size,) of the features


def error_rows(
    kind: Kind, weights: Mapping[str, Any], latents: int, states: States
) -> dict[str, list[dict[str, Any]]]:
    """Returns the rows of `encoder_features` and `encoder_errors`, without the encoder.

    They are errors on held-out episodes, `test`, and on those of the hand-written policy,
    `heuristic`, which other robots do not have.
    """
    evaluated = {"test": _Evaluated(states.test(), states.held_out)}
    if find_task(states.task).hand_written() is not None:
        evaluated["heuristic"] = _heuristic_states(states)

    on_device = {name: torch.from_numpy(value).to(states.device) for name, value in weights.items()}
    size = min(latents, states.size)  # there may be more latents than features
    baselines = {name: (other, other.fit(states, size)) for name, other in _BASELINES.items()}
    columns: dict[str, FloatArray] = {}
    totals: dict[str, Any] = {}

    for episodes, (shards, moments) in evaluated.items():
        errors = reconstruction_errors(kind, on_device, shards)
        mses = {episodes: errors.mse}
        for name, (baseline, fitted) in baselines.items():
            if episodes != "test":
                name += f"_{episodes}"
            mses[name] = affine_errors(baseline, fitted, moments)

        for name, mse in mses.items():
            columns[f"{name}_mse"] = mse

        columns[f"{episodes}_variance"] = errors.variance
        totals[f"{episodes}_states"] = moments.rows
        for name, mse in mses.items():
            totals[f"{name}_explained"] = _explained(mse, errors.variance)

    for name, values in columns.items():
        totals[name] = float(values.mean())

    features = []
    for i, label in enumerate(states.labels):
        feature = {"index": states.columns[i], "feature": label}
        features.append({**feature, **{name: values[i] for name, values in columns.items()}})

    return {"encoder_features": features, "encoder_errors": [totals]}


def _explained(mse: FloatArray, variance: FloatArray) -> float:
    """Returns the share of the variance that is no error; 0 of states that do not vary."""
    total = variance.sum()
    if not total:
        return 0.0
    return float(1 - mse.sum() / total)


def _heuristic_states(states: States) -> _Evaluated:
    """Returns states of the hand-written policy, scaled as those of a dataset, on their device."""
    episodes = heuristic_episodes(states.task, states.dataset.settings.augment)
    scaled = states.scaled(episodes)
    unused = torch.empty(0)  # actions and rewards
    shard = Shard(torch.from_numpy(scaled), unused, unused).to(states.device)
    return _Evaluated([shard], Moments.of(scaled))


@torch.no_grad()
def reconstruction_errors(
    kind: Kind, weights: Mapping[str, Tensor], shards: Iterable[Shard]
) -> _Errors:
    """Returns the errors of a kind's reconstruction of states, or of those that it decodes."""
    steps_to_decoded = 0
    if kind.decodes_later:
        steps_to_decoded = kind.steps_ahead

    sums: Any = 0
    count = 0
    for batch in state_pairs(shards, steps_to_decoded):
        target = batch.later.double()
        error = kind.from_latents(weights, kind.to_latents(weights, batch.now)) - batch.later
        summed = (error.double().square(), target, target.square())
        sums = sums + torch.stack([values.sum(0) for values in summed]).cpu().numpy()
        count += len(batch.now)

    mse, mean, square = sums / count
    return _Errors(mse, np.maximum(square - mean**2, 0))


@cache
def heuristic_episodes(task: str, augment: int | None) -> NDArray[np.float32]:
    """Returns (10, 1001, size) observations of the hand-written policy."""
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
