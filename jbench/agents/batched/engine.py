"""Agents of several seeds that learn one task side by side: the loop, and all of its state."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.environments import Environments, Step
from jbench.agents.batched.learner import LOSS_SUMS, Learner
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.team import Team
from jbench.agents.divergence import Divergence, divergent_loss
from jbench.closing import Closing
from jbench.policies.saved import Policy

_AGENT, _WORLD, _LOOP = "agent/", "environments/", "loop/"


class SeedState(NamedTuple):
    """All of one seed but the rows of its replay buffer.

    Attributes:
        tensors: by name, on the CPU, none sharing memory: as safetensors wants them.
        scalars: what JSON can say.
    """

    tensors: dict[str, Tensor]
    scalars: dict[str, Any]


class Engine(Closing):
    """Agents of several seeds that learn side by side; each learns what it would learn alone.

    Use it as a context manager: it holds threads.

    Attributes:
        environments: what the agents learn in.
        control_steps: of each seed, over all its environments.
        updates: of each seed.
        diverged: the seeds that have diverged, by their places. The others are not affected: a
            diverged seed's robots get the action 0, and it may learn no more.
    """

    def __init__(
        self,
        team: Team[Any],
        environments: Environments,
        streams: Sequence[Streams],
        rollout_steps: int,
    ) -> None:
        """Begins with agents that know nothing.

        Args:
            team: the agents.
            environments: what they learn in.
            streams: of every seed.
            rollout_steps: of each environment from one learning to the next.
        """
        self.environments = environments
        self.control_steps = self.updates = 0
        self._team, self._streams, self._rollout_steps = team, streams, rollout_steps
        self.diverged: dict[int, Divergence] = {}
        self._collected = 0
        team.initialize(streams)
        # All that must stay finite; the log temperature of SAC is -inf if ent_coef is 0.
        kept = team.tensors.kept
        self._finite = [n for n in kept if n != LOSS_SUMS and bool(kept[n].isfinite().all())]

    def close(self) -> None:
        """Ends the threads."""
        self.environments.close()

    def learn(self, steps: int) -> Iterator[NDArray[np.float64] | None]:
        """Learns until each seed has had so many control steps, to the end of a rollout.

        Between two control steps the caller may do with the agents what it likes: what a step
        taught is learned when the next one is asked for, also after `restore`.

        Args:
            steps: of each seed, since the very first.

        Yields:
            After each step of all robots, the returns (seeds, environments) of the episodes that
            ended with it, or None.
        """
        while True:
            if self._collected == self._rollout_steps:
                self._learn()
                self._check_losses()
                self._collected = 0
            if self._collected == 0 and self.control_steps >= steps:
                break
            observations = self.environments.observations
            actions = self._checked_actions(self._explore_actions(observations))
            step = self.environments.step(actions)
            self.control_steps += actions.shape[1]
            self._collected += 1
            self._store(observations, actions, step)
            yield step.episode_returns

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the deterministic actions (seeds, N, 1) of every agent in [-1, 1].

        Those of diverged agents are 0.

        Args:
            observations: (seeds, N, dim(O)) of the task, not encoded.
        """
        seen = self.environments.encode(torch.from_numpy(observations))
        actions: NDArray[np.float32] = self._team.run(_act, seen).float().numpy()
        actions[list(self.diverged)] = 0
        return actions

    def evaluate(self, environments: Environments) -> NDArray[np.float64]:
        """Returns the returns (seeds, N) of one episode of each robot, deterministic actions.

        Args:
            environments: of the evaluation, at the beginning of an episode, N for every agent.
        """
        while True:
            actions = self._team.run(_act, environments.observations)[..., 0]
            returns = environments.step(actions.numpy()).episode_returns
            if returns is not None:
                return returns

    def policy(self, seed: int) -> Policy:
        """Returns a copy of the deterministic policy of the seed in the given place."""
        return self._team.policy(seed)

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses of a seed by the names of the database; none before any."""
        sums, counts = self._team.tensors.kept[LOSS_SUMS][seed].cpu().unbind(dim=-1)
        means = zip(self._team.each[seed].losses, counts, (sums / counts).tolist(), strict=True)
        return {name: mean for name, count, mean in means if count}

    def check_weights(self) -> None:
        """Notes in `diverged` the seeds whose weights or optimisers are not finite."""
        for name in self._finite:
            for seed in self._not_finite(name):
                self._note_divergence(seed, "weights")

    def state(self, seed: int) -> SeedState:
        """Returns all of one seed but its replay rows, between any two control steps."""
        tensors = {_AGENT + name: kept[seed] for name, kept in self._team.tensors.kept.items()}
        world = self.environments.state(seed)
        tensors |= {_WORLD + name: torch.from_numpy(value) for name, value in world.items()}
        tensors |= {_LOOP + name: tensor for name, tensor in self._loop_state(seed).items()}
        scalars = {
            "control_steps": self.control_steps,
            "updates": self.updates,
            "collected": self._collected,
            "episodes": self.environments.episodes,
            "episode_steps": self.environments.steps,
            "streams": self._streams[seed].state(),
        }
        copies = {name: tensor.detach().cpu().clone() for name, tensor in tensors.items()}
        return SeedState(copies, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """Puts all seeds where they were; on a CPU, what follows is the same bit for bit.

        Args:
            states: of every seed. An off-policy engine is given its replay rows before.

        Raises:
            ValueError: if the seeds have not had equally many control steps.
        """
        first = states[0].scalars
        if any(state.scalars["control_steps"] != first["control_steps"] for state in states):
            raise ValueError("Seeds that learn side by side have had equally many control steps.")
        for seed, (tensors, scalars) in enumerate(states):
            for name, kept in self._team.tensors.kept.items():
                kept[seed] = tensors[_AGENT + name]
            world = {name: tensor.numpy() for name, tensor in _under(_WORLD, tensors).items()}
            steps = scalars["episodes"], scalars["episode_steps"]
            self.environments.restore(seed, world, *steps)
            self._streams[seed].restore(scalars["streams"])
            self._restore_loop(seed, _under(_LOOP, tensors))
        self.control_steps, self.updates = first["control_steps"], first["updates"]
        self._collected = first["collected"]

    def _check_losses(self) -> None:
        """Notes the seeds with a loss that is not finite, after an update."""
        for seed in self._not_finite(LOSS_SUMS):
            self._note_divergence(seed, divergent_loss(self.losses(seed)) or "losses")

    def _checked_actions(self, actions: NDArray[np.floating]) -> NDArray[np.floating]:
        """Notes the seeds with actions that are not finite, and sets these to 0.

        MuJoCo would print a warning and take them for 0 itself.
        """
        finite = np.isfinite(actions).all(axis=1)
        if not finite.all():
            for seed in np.flatnonzero(~finite).tolist():
                self._note_divergence(seed, "actions")
            actions[~finite] = 0
        return actions

    def _not_finite(self, name: str) -> list[int]:
        """Returns the seeds whose tensor of that name is not finite."""
        finite = self._team.tensors.kept[name].isfinite().view(len(self._streams), -1).all(dim=1)
        # One small copy from a GPU, also where all are finite.
        return [seed for seed, is_finite in enumerate(finite.tolist()) if not is_finite]

    def _note_divergence(self, seed: int, what: str) -> None:
        """Notes that a seed has diverged; of several signs the first counts."""
        self.diverged.setdefault(seed, Divergence(self.updates, self.control_steps, what))

    def _still_learning(self, seeds: range) -> bool:
        """Returns whether one of some seeds has not diverged."""
        return not all(seed in self.diverged for seed in seeds)

    @abstractmethod
    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        """Returns actions (seeds, environments) to learn from."""

    @abstractmethod
    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: Step) -> None:
        """Keeps what a control step has taught."""

    @abstractmethod
    def _learn(self) -> None:
        """Learns from what was remembered."""

    @abstractmethod
    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """Returns what the loop remembers of a seed."""

    @abstractmethod
    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """Takes back what `_loop_state` gave."""


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Returns the tensors whose names begin so, by the rest of their names."""
    own = {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}
    return own


def _act(agent: Learner, observations: Tensor) -> Tensor:
    return agent.act(observations)
