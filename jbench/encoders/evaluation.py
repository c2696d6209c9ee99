"""Reconstruction errors of an encoder on held-out episodes and on episodes of the heuristic.

PCA and a random projection of the same size, fitted to the same states, are evaluated for
comparison.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import ClosedForm, Kind
from jbench.encoders.kinds.linear import PrincipalComponents, RandomProjection
from jbench.encoders.moments import FloatArray, Moments, affine_errors
from jbench.encoders.pairs import Shard
from jbench.encoders.states import States
from jbench.names import TASKS
from jbench.simulation import find_task, rollout
from jbench.store import encoder_schema
from jbench.tasks import resets
from jbench.tasks.heuristics import heuristic

_EPISODES = 10  # of the heuristic
_THREADS = 2
_SEED = 20200419  # not used by `jbench evaluate` or for tuning the heuristics

_BASELINES: dict[str, ClosedForm] = {"pca": PrincipalComponents(), "random": RandomProjection()}


class Errors(NamedTuple):
    """Mean squared errors on some states.

    Attributes:
        mse: (size,) error of each scaled feature.
        variance: (size,) variance of each scaled feature of the target states.
        pca: (size,) errors of PCA of the same size.
        random: (size,) errors of a random projection of the same size.
        states: number of states.
    """

    mse: FloatArray
    variance: FloatArray
    pca: FloatArray
    random: FloatArray
    states: int

    def explained(self, mse: FloatArray) -> float:
        """Returns the explained fraction of the total variance of the features."""
        total = self.variance.sum()
        return float(1 - mse.sum() / total) if total else 0.0


def evaluate_encoder(
    kind: Kind, weights: Mapping[str, Any], latents: int, states: States
) -> dict[str, Errors]:
    """Returns the errors on held-out episodes, `test`, and on hand-written ones, `heuristic`.

    Of another robot no heuristic is known.

    Args:
        weights: numpy arrays in float32.
        states: the encoder's training data.
    """
    data: dict[str, tuple[Iterable[Shard], Moments]] = {"test": (states.test(), states.held_out)}
    if states.task in TASKS:
        augment = states.dataset.record.settings.get("augment")
        observations, *actions_and_rewards = heuristic_episodes(states.task, augment)
        scaled = states.scaled(observations)
        shard = Shard(*map(torch.from_numpy, (scaled, *actions_and_rewards))).to(states.device)
        data["heuristic"] = [shard], Moments.of(scaled)
    on_device = {n: torch.from_numpy(v).to(states.device) for n, v in weights.items()}
    # There may be more latents than features.
    size = min(latents, states.size)
    baselines = {
        name: _reconstruction(other, other.fit(states.learned, size, states.seed), states.size)
        for name, other in _BASELINES.items()
    }
    return {
        name: Errors(
            *reconstruction_errors(kind, on_device, shards),
            **{baseline: affine_errors(*affine, moments) for baseline, affine in baselines.items()},
            states=moments.rows,
        )
        for name, (shards, moments) in data.items()
    }


def error_tables(encoder: str, task: str, errors: Mapping[str, Errors]) -> dict[str, pa.Table]:
    """Returns the rows of an encoder's errors, per feature and over all features.

    Args:
        encoder: its id.
        errors: see `evaluate_encoder`.
    """
    columns: dict[str, FloatArray] = {}
    totals: dict[str, Any] = {"encoder": encoder}
    for episodes, its in errors.items():
        end = "" if episodes == "test" else f"_{episodes}"
        columns |= {
            f"{episodes}_mse": its.mse,
            f"{episodes}_variance": its.variance,
            f"pca{end}_mse": its.pca,
            f"random{end}_mse": its.random,
        }
        totals |= {
            f"{episodes}_states": its.states,
            f"{episodes}_explained": its.explained(its.mse),
            f"pca{end}_explained": its.explained(its.pca),
            f"random{end}_explained": its.explained(its.random),
        }
    features = [
        {
            "encoder": encoder,
            "index": index,
            "feature": label,
            **{name: float(values[index]) for name, values in columns.items()},
        }
        for index, label in enumerate(find_task(task).labels)
    ]
    totals |= {name: float(values.mean()) for name, values in columns.items()}
    return {
        "encoder_features": pa.Table.from_pylist(features, encoder_schema.ENCODER_FEATURES),
        "encoder_errors": pa.Table.from_pylist([totals], encoder_schema.ENCODER_ERRORS),
    }


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
    """Returns (10, 1001, size) observations of a task's heuristic, (10, 1000) actions and rewards.

    The seeds are fixed, so the episodes are the same in every process.

    Args:
        augment: seed of the augmented robot; None for the plain robot.
    """
    generators = [resets.episode_generator(_SEED, episode) for episode in range(_EPISODES)]
    policy = heuristic(task)
    policy.reset(_EPISODES)

    def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return policy.act(observations).astype(np.float32)

    with find_task(task).worlds(_EPISODES, _THREADS, augment) as worlds:
        steps = list(rollout(worlds, worlds.reset(generators), act))
    observations = [steps[0].observations, *(step.next_observations for step in steps)]
    actions = [step.actions[:, 0].astype(np.float32) for step in steps]
    rewards = [step.rewards.astype(np.float32) for step in steps]
    return np.stack(observations, axis=1), np.stack(actions, axis=1), np.stack(rewards, axis=1)


def _reconstruction(
    kind: ClosedForm, weights: Mapping[str, FloatArray], size: int
) -> tuple[FloatArray, FloatArray]:
    """Returns matrix (size, size) and shift (size,) of an affine reconstruction."""

    def rebuilt(rows: FloatArray) -> FloatArray:
        values: FloatArray = kind.decode(weights, kind.encode(weights, rows))
        return values

    shift = rebuilt(np.zeros(size))
    return (rebuilt(np.eye(size)) - shift).T, shift
