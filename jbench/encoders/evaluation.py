"""The errors of an encoder: on held-out episodes, and on those of a policy that is not random.

Beside every encoder stand PCA's errors and those of a random projection of the same size, fitted to
the same states and told on the same scaled ones.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import ClosedForm, Kind
from jbench.encoders.kinds.pca import PrincipalComponents
from jbench.encoders.kinds.random_projection import RandomProjection
from jbench.encoders.moments import FloatArray, Moments, affine_errors
from jbench.encoders.states import Shard, States
from jbench.simulation import Robots, rollout
from jbench.tasks import model as robot
from jbench.tasks import resets
from jbench.tasks.heuristics import heuristic

_EPISODES = 10  # of the heuristic
_THREADS = 2
# None of the seeds of `jbench evaluate` or of a tuning: an entropy of its own.
_SEED = 20200419
_ROWS = 65536  # reconstructed at a time

_BESIDE: dict[str, ClosedForm] = {"pca": PrincipalComponents(), "random": RandomProjection()}


class Errors(NamedTuple):
    """Mean squared errors on some states.

    Attributes:
        mse: (size,) of each scaled feature.
        variance: (size,) of each scaled feature of the states that are reconstructed.
        pca: (size,) of PCA of the same size.
        random: (size,) of a random projection of the same size.
        states: how many.
    """

    mse: FloatArray
    variance: FloatArray
    pca: FloatArray
    random: FloatArray
    states: int

    def explained(self, mse: FloatArray) -> float:
        """Returns the fraction of the states' variance that is explained, all features together."""
        total = self.variance.sum()
        return float(1 - mse.sum() / total) if total else 0.0


def judge(
    kind: Kind, weights: Mapping[str, Any], latents: int, states: States
) -> dict[str, Errors]:
    """Returns the errors on the held-out episodes, `test`, and on the heuristic's, `heuristic`.

    Args:
        kind: of the encoder.
        weights: of the encoder, float32, of numpy.
        latents: how many.
        states: those that it was trained on.
    """
    augment = states.dataset.record.settings.get("augment")
    observed, *commanded = heuristic_episodes(states.task, augment)
    ours = states.scale(observed)
    foreign = Shard(*map(torch.from_numpy, (ours, *commanded))).to(states.device)
    on_device = {n: torch.from_numpy(v).to(states.device) for n, v in weights.items()}
    judged = {"test": (states.test(), states.held_out), "heuristic": ([foreign], Moments.of(ours))}
    # Where there are more latents than features, PCA and random directions of all features.
    size = min(latents, states.size)
    beside = {
        name: _reconstruction(other, other.fit(states.learned, size, states.seed), states.size)
        for name, other in _BESIDE.items()
    }
    return {
        data: Errors(
            *reconstruction_errors(kind, on_device, shards),
            **{name: affine_errors(*affine, moments) for name, affine in beside.items()},
            states=moments.rows,
        )
        for data, (shards, moments) in judged.items()
    }


@torch.no_grad()
def reconstruction_errors(
    kind: Kind, weights: Mapping[str, Tensor], shards: Iterable[Shard]
) -> tuple[FloatArray, FloatArray]:
    """Returns the (size,) mean squared errors and variances of what a kind reconstructs."""
    sums: Any = 0
    count = 0
    for shard in shards:
        ahead = kind.steps_ahead if kind.decodes_later else 0
        for chosen in torch.arange(shard.pairs(ahead), device=shard.states.device).split(_ROWS):
            batch = shard.take(chosen, ahead)
            wanted = batch.later.double()
            error = kind.decode(weights, kind.encode(weights, batch.now)) - batch.later
            of = (error.double().square(), wanted, wanted.square())
            sums = sums + torch.stack([values.sum(0) for values in of]).cpu().numpy()
            count += len(chosen)
    error_of, mean, square = sums / count
    return error_of, np.maximum(square - mean**2, 0)


@cache
def heuristic_episodes(
    task: str, augment: int | None
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Returns (10, 1001, size) observations of a task's heuristic, (10, 1000) actions and rewards.

    They are the same in every process: the seeds are fixed, and used for nothing else.

    Args:
        task: one of `jbench.names.TASKS`.
        augment: seed of the augmented robot; None for the plain one.
    """
    generators = [resets.episode_generator(_SEED, episode) for episode in range(_EPISODES)]
    starts = resets.draw_starts(task, generators)
    policy = heuristic(task)
    policy.reset(_EPISODES)

    def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return policy.act(observations).astype(np.float32)

    with Robots(robot.load(augment), _EPISODES, _THREADS) as robots:
        steps = list(rollout(task, robots, starts, act))
    observed = [steps[0].observations, *(step.next_observations for step in steps)]
    actions = [step.actions.astype(np.float32) for step in steps]
    rewards = [step.rewards.astype(np.float32) for step in steps]
    return np.stack(observed, axis=1), np.stack(actions, axis=1), np.stack(rewards, axis=1)


def _reconstruction(
    kind: ClosedForm, weights: Mapping[str, FloatArray], size: int
) -> tuple[FloatArray, FloatArray]:
    """Returns matrix (size, size) and shift (size,) of a reconstruction that is affine."""

    def rebuilt(rows: FloatArray) -> FloatArray:
        values: FloatArray = kind.decode(weights, kind.encode(weights, rows))
        return values

    shift = rebuilt(np.zeros(size))
    return (rebuilt(np.eye(size)) - shift).T, shift
