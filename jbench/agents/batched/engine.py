"""The training loop of several seeds, and its complete state."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.environments import Environments, Step
from jbench.agents.batched.learner import LOSS_SUMS, Learner
from jbench.agents.batched.team import Team
from jbench.agents.divergence import Divergence, divergent_loss
from jbench.closing import Closing
from jbench.policies.network import SavedNetwork

_AGENT, _LOOP = "agent/", "loop/"
WORLD = "environments/"
"""Prefix of the tensors of the robots in a state."""


class SeedState(NamedTuple):
    """The state of one seed, except for its replay buffer.

    Attributes:
        tensors: by name, on the CPU, without shared memory, as safetensors requires.
        scalars: everything else, serialisable as JSON.
    """

    tensors: dict[str, Tensor]
    scalars: dict[str, Any]


class Engine(Closing):
    """Trains several seeds side by side; each learns what it would learn alone.

    Use it as a context manager: it holds threads.

    Attributes:
        control_steps: per seed, over all its environments.
        updates: per seed.
        diverged: the diverged seeds by index. Their robots get the action 0 and they may stop
            learning; the other seeds are not affected.
        is_resumable: whether there are `state` and `restore`.
        keeps_policy_exactly: whether the actions of a copy from `policy`, loaded again, are those
            of the agent bit for bit.
    """

    is_resumable = keeps_policy_exactly = True

    def __init__(self, team: Team[Any], environments: Environments, rollout_steps: int) -> None:
        """Starts with untrained agents.

        Args:
            rollout_steps: steps of each environment between learning phases.
        """
        self.environments = environments
        self.control_steps = self.updates = 0
        self._team, self._generators, self._rollout_steps = team, team.generators, rollout_steps
        self.diverged: dict[int, Divergence] = {}
        self._collected, self._unchecked = 0, False
        team.initialize()
        # Tensors that must stay finite; the log temperature of SAC is -inf if ent_coef is 0.
        saved = team.tensors.saved
        self._finite = [n for n in saved if n != LOSS_SUMS and bool(saved[n].isfinite().all())]

    def close(self) -> None:
        """Ends the threads."""
        self.environments.close()

    def learn(self, steps: int) -> Iterator[NDArray[np.float64] | None]:
        """Trains until each seed has made `steps` control steps and completed a rollout.

        Learning happens when the step after a completed rollout is requested, also after
        `restore`, so the caller can evaluate or save the agents between any two steps. The caller
        may begin it earlier, with `begin_updates`.

        Args:
            steps: per seed, counted from the start of training.

        Yields:
            After each step of all robots, the returns (seeds, environments) of the episodes that
            ended with it, or None.
        """
        while True:
            if self.begin_updates() or self._unchecked:
                self._check_losses()
                self._unchecked = False
            if self._collected == 0 and self.control_steps >= steps:
                break
            observations = self.environments.observations
            actions = self._checked_actions(self._explore_actions(observations))
            step = self.environments.step(actions)
            self.control_steps += actions.shape[1]
            self._collected += 1
            self._store(observations, actions, step)
            yield step.episode_returns

    def has_made(self, steps: int) -> bool:
        """Returns whether `learn` makes no more control steps, but for the last updates."""
        return self.control_steps >= steps and self._collected in (0, self._rollout_steps)

    def begin_updates(self) -> bool:
        """Begins the updates that are due after a rollout; a GPU makes them in the background.

        Returns:
            Whether updates were due.
        """
        if self._collected < self._rollout_steps:
            return False
        self._learn()
        self._collected, self._unchecked = 0, True
        return True

    def act(self, observations: NDArray[np.float32], first: int = 0) -> NDArray[np.float32]:
        """Returns deterministic actions (n, N, dim(A)) in [-1, 1]; 0 for diverged agents.

        Args:
            observations: (n, N, dim(O)) of the task, not encoded, of n consecutive seeds of a cell.
            first: index of the first of these seeds.
        """
        seen = torch.from_numpy(observations)
        inputs = self.environments.encode(seen, first)
        seeds = slice(first, first + len(inputs))
        if len(inputs) < len(self._generators):
            of_all = inputs.new_zeros(len(self._generators), *inputs.shape[1:])
            of_all[seeds] = inputs
            inputs = of_all
        actions: NDArray[np.float32] = self._team.run(act, inputs).float().numpy()
        actions[list(self.diverged)] = 0
        robot_actions: NDArray[np.float32] = actions[seeds] * self.environments.action_signs(
            seen, first
        )
        return robot_actions

    def policy(self, seed: int) -> SavedNetwork:
        """Returns a copy of the deterministic policy of the seed with this index."""
        return self._team.policy(seed)

    def load_policy(self, seed: int, policy: SavedNetwork, control_steps: int) -> None:
        """Sets the deterministic policy of one seed, for `act`.

        Args:
            policy: from `policy`, of the same settings.
            control_steps: after which it was copied.

        Raises:
            ValueError: if it has other layers than the seed's agent.
        """
        self._team.load_policy(seed, policy)
        self.control_steps = control_steps

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses of a seed by database name; empty before the first update."""
        sums, counts = self._team.tensors.saved[LOSS_SUMS][seed].cpu().unbind(dim=-1)
        means = zip(self._team.each[seed].losses, counts, (sums / counts).tolist(), strict=True)
        return {name: mean for name, count, mean in means if count}

    def check_weights(self) -> None:
        """Records in `diverged` the seeds whose weights or optimizer moments are not finite."""
        for name in self._finite:
            for seed in self._not_finite(name):
                self._record_divergence(seed, "weights")

    def state(self, seed: int) -> SeedState:
        """Returns the state of one seed without its replay rows, at any control step.

        It is that of the seed alone, without the padding of a stack of several cells.
        """
        tensors = {_AGENT + name: value for name, value in self._team.state(seed).items()}
        world = self.environments.state(seed)
        tensors |= {WORLD + name: torch.from_numpy(value) for name, value in world.items()}
        tensors |= {_LOOP + name: tensor for name, tensor in self._loop_state(seed).items()}
        scalars = {
            "control_steps": self.control_steps,
            "updates": self.updates,
            "collected": self._collected,
            "episodes": self.environments.episodes,
            "episode_steps": self.environments.steps,
            "streams": self._generators[seed].state(),
        }
        copies = {name: tensor.detach().cpu().clone() for name, tensor in tensors.items()}
        return SeedState(copies, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """Restores all seeds; on a CPU, training continues with the same bits.

        Args:
            states: of every seed. The replay rows of an off-policy engine must be restored before.

        Raises:
            ValueError: if the seeds have made different numbers of control steps.
        """
        first = states[0].scalars
        if any(state.scalars["control_steps"] != first["control_steps"] for state in states):
            raise ValueError(
                "All seeds of an engine must have made the same number of control steps."
            )
        for seed, (tensors, scalars) in enumerate(states):
            self._team.restore(seed, under(_AGENT, tensors))
            world = {name: tensor.numpy() for name, tensor in under(WORLD, tensors).items()}
            steps = scalars["episodes"], scalars["episode_steps"]
            self.environments.restore(seed, world, *steps)
            self._generators[seed].restore(scalars["streams"])
            self._restore_loop(seed, under(_LOOP, tensors))
        self.control_steps, self.updates = first["control_steps"], first["updates"]
        self._collected, self._unchecked = first["collected"], False

    def _check_losses(self) -> None:
        """Records the seeds with a loss that is not finite."""
        for seed in self._not_finite(LOSS_SUMS):
            self._record_divergence(seed, divergent_loss(self.losses(seed)) or "losses")

    def _checked_actions(self, actions: NDArray[np.floating]) -> NDArray[np.floating]:
        """Records the seeds with actions that are not finite, and sets those actions to 0.

        MuJoCo would print a warning and set them to 0 itself.
        """
        finite = np.isfinite(actions).all(axis=(1, 2))
        if not finite.all():
            for seed in np.flatnonzero(~finite).tolist():
                self._record_divergence(seed, "actions")
            actions[~finite] = 0
        return actions

    def _not_finite(self, name: str) -> list[int]:
        """Returns the seeds whose tensor `name` is not finite."""
        values = self._team.tensors.saved[name]
        finite = values.isfinite().view(len(values), -1).all(dim=1)
        # Only one small copy from a GPU.
        return [seed for seed, is_finite in enumerate(finite.tolist()) if not is_finite]

    def _record_divergence(self, seed: int, what: str) -> None:
        """Records the first sign that a seed has diverged."""
        self.diverged.setdefault(seed, Divergence(self.updates, self.control_steps, what))

    def _still_learning(self, seeds: range) -> bool:
        """Returns whether any of these seeds has not diverged."""
        return not all(seed in self.diverged for seed in seeds)

    @abstractmethod
    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        """Returns exploring actions (seeds, environments, action_size)."""

    @abstractmethod
    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: Step) -> None:
        """Stores the transitions of a control step."""

    @abstractmethod
    def _learn(self) -> None:
        """Makes the updates that are due after a rollout."""

    @abstractmethod
    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """Returns the state of the loop for one seed."""

    @abstractmethod
    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """Restores what `_loop_state` returned."""


def under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Returns the tensors whose names start with a prefix, with the prefix removed."""
    return {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}


def act(agent: Learner, observations: Tensor) -> Tensor:
    """Returns an agent's deterministic actions; see `Team.run`."""
    return agent.act(observations)
