"""Reconstruction errors of an encoder on held-out episodes and on episodes of the heuristic.

PCA and a random projection of the same size, fitted to the same states, are evaluated for
comparison.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Fitted, Kind
from jbench.encoders.kinds.linear import PrincipalComponents, RandomProjection
from jbench.encoders.scaling import FloatArray, Moments
from jbench.encoders.states import Shard, States
from jbench.names import TASKS
from jbench.simulation import find_task, rollout
from jbench.tasks import resets
from jbench.tasks.heuristics import heuristic

_EPISODES = 10  # of the heuristic
_THREADS = 2
_SEED = 20200419  # not used by `jbench evaluate` or for tuning the heuristics

_BASELINES: dict[str, Fitted] = {"pca": PrincipalComponents(), "random": RandomProjection()}


def errors(
    kind: Kind, weights: Mapping[str, Any], latents: int, states: States
) -> dict[str, list[dict[str, Any]]]:
    """Returns the rows of `encoder_features` and `encoder_errors`, without the encoder.

    They are errors on held-out episodes, `test`, and on those of the hand-written policy,
    `heuristic`, which other robots do not have.
    """
    data: dict[str, tuple[Iterable[Shard], Moments]] = {"test": (states.test(), states.held_out)}
    if states.task in TASKS:
        augment = states.dataset.record.settings.get("augment")
        observations, *actions_and_rewards = heuristic_episodes(states.task, augment)
        scaled = states.scaled(observations)
        shard = Shard(*map(torch.from_numpy, (scaled, *actions_and_rewards))).to(states.device)
        data["heuristic"] = [shard], Moments.of(scaled)
    on_device = {name: torch.from_numpy(value).to(states.device) for name, value in weights.items()}
    # There may be more latents than features.
    size = min(latents, states.size)
    baselines = {
        name: (other, other.fit(states, size))
        for name, other in _BASELINES.items()
    }
    columns: dict[str, FloatArray] = {}
    totals: dict[str, Any] = {}
    for episodes, (shards, moments) in data.items():
        mse, variance = reconstruction_errors(kind, on_device, shards)
        end = "" if episodes == "test" else f"_{episodes}"
        mses = {episodes: mse} | {
            f"{name}{end}": affine_errors(*fitted, moments) for name, fitted in baselines.items()
        }
        columns |= {f"{name}_mse": error for name, error in mses.items()}
        columns[f"{episodes}_variance"] = variance
        totals[f"{episodes}_states"] = moments.rows
        total = variance.sum()
        for name, error in mses.items():
            totals[f"{name}_explained"] = float(1 - error.sum() / total) if total else 0.0
    totals |= {name: float(values.mean()) for name, values in columns.items()}
    features = [
        {"index": i, "feature": label, **{name: values[i] for name, values in columns.items()}}
        for i, label in enumerate(find_task(states.task).labels)
    ]
    return {"encoder_features": features, "encoder_errors": [totals]}


@torch.no_grad()
def reconstruction_errors(
    kind: Kind, weights: Mapping[str, Tensor], shards: Iterable[Shard]
) -> tuple[FloatArray, FloatArray]:
    """Returns the (size,) mean squared errors of a kind and the variances of its targets."""
    sums: Any = 0
    count = 0
    for shard in shards:
        ahead = kind.steps_ahead if kind.decodes_later else 0
        for batch in shard.blocks(ahead):
            target = batch.later.double()
            error = kind.from_latents(weights, kind.to_latents(weights, batch.now)) - batch.later
            summed = (error.double().square(), target, target.square())
            sums = sums + torch.stack([values.sum(0) for values in summed]).cpu().numpy()
            count += len(batch.now)
    mse, mean, square = sums / count
    return mse, np.maximum(square - mean**2, 0)


@cache
def heuristic_episodes(
    task: str, augment: int | None
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Returns (10, 1001, size) observations of the heuristic, (10, 1000) actions and rewards."""
    generators = [resets.episode_generator(_SEED, episode) for episode in range(_EPISODES)]
    policy = heuristic(task)
    policy.reset(_EPISODES)
    with find_task(task).worlds(_EPISODES, _THREADS, augment) as worlds:
        first = worlds.reset(generators)
        steps = list(rollout(worlds, first, lambda seen: policy.act(seen).astype(np.float32)))
    observations = [steps[0].observations, *(step.next_observations for step in steps)]
    actions = [step.actions[:, 0].astype(np.float32) for step in steps]
    rewards = [step.rewards.astype(np.float32) for step in steps]
    return np.stack(observations, axis=1), np.stack(actions, axis=1), np.stack(rewards, axis=1)


def affine_errors(kind: Kind, weights: Mapping[str, FloatArray], moments: Moments) -> FloatArray:
    """Returns the (size,) mean squared errors of an affine kind, which follow from the moments."""
    identity = np.eye(len(moments.mean))
    shift = kind.decode(weights, kind.encode(weights, np.zeros_like(moments.mean)))
    matrix = (kind.decode(weights, kind.encode(weights, identity)) - shift).T
    difference = matrix - identity
    bias = difference @ moments.mean + shift
    variance = np.einsum("ij,jk,ik->i", difference, moments.covariance, difference)
    mses: FloatArray = np.maximum(variance + bias**2, 0)
    return mses
