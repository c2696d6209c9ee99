"""The engine of update rules: the agents of all seeds, and their complete state."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.learner import LOSS_SUMS, Learner
from jbench.agents.batched.team import Team
from jbench.agents.divergence import divergent_loss
from jbench.agents.engine import Engine, SeedState, under
from jbench.agents.environments import Environments
from jbench.policies.network import SavedNetwork

_AGENT, _LOOP = "agent/", "loop/"


class BatchedEngine(Engine):
    """Trains a team of learners."""

    updates: int

    def __init__(self, team: Team[Any], environments: Environments, rollout_steps: int) -> None:
        """Starts with untrained agents; see `Engine`."""
        super().__init__(environments, team.generators, rollout_steps)
        self._team, self._saved, self.updates = team, team.tensors.saved, 0
        for learner, generators in zip(team.learners, team.generators, strict=True):
            learner.initialize(generators.weights())
        # Tensors that must stay finite; the log temperature of SAC is -inf if ent_coef is 0.
        self._finite = [
            name
            for name, values in self._saved.items()
            if name != LOSS_SUMS and bool(values.isfinite().all())
        ]

    def policy(self, seed: int) -> SavedNetwork:
        """Returns a copy of the deterministic policy of the seed with this index."""
        policy: SavedNetwork = self._team.learners[seed].policy()
        return policy

    def load_policy(self, seed: int, policy: SavedNetwork, control_steps: int) -> None:
        """Sets the deterministic policy of one seed, for `act`.

        Args:
            policy: from `policy`, of the same settings.
            control_steps: after which it was copied.

        Raises:
            ValueError: if it has other layers than the seed's agent.
        """
        self._team.learners[seed].load_policy(policy)
        self.control_steps = control_steps

    def losses(self, seed: int) -> dict[str, float]:
        """See `Engine.losses`."""
        sums, counts = self._saved[LOSS_SUMS][seed].cpu().unbind(dim=-1)
        means = zip(self._team.learners[seed].losses, counts, (sums / counts).tolist(), strict=True)
        return {name: mean for name, count, mean in means if count}

    def check_weights(self) -> None:
        """See `Engine.check_weights`."""
        for name in self._finite:
            for seed in self._not_finite(name):
                self._record_divergence(seed, "weights")

    def state(self, seed: int) -> SeedState:
        """See `Engine.state`."""
        robots = self._robots_state(seed)
        tensors = {_AGENT + name: values[seed] for name, values in self._saved.items()}
        tensors |= robots.tensors
        tensors |= {_LOOP + name: values for name, values in self._loop_state(seed).items()}
        scalars = {
            "control_steps": self.control_steps,
            "updates": self.updates,
            "collected": self._collected,
            **robots.scalars,
        }
        copies = {name: values.detach().cpu().clone() for name, values in tensors.items()}
        return SeedState(copies, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """See `Engine.restore`.

        Raises:
            ValueError: if the seeds have made different numbers of control steps.
        """
        first = states[0].scalars
        if any(state.scalars["control_steps"] != first["control_steps"] for state in states):
            raise ValueError(
                "All seeds of an engine must have made the same number of control steps."
            )
        for seed, state in enumerate(states):
            agent = under(_AGENT, state.tensors)
            for name, values in self._saved.items():
                values[seed] = agent[name]
            self._restore_robots(seed, state)
            self._restore_loop(seed, under(_LOOP, state.tensors))
        self.control_steps, self.updates = first["control_steps"], first["updates"]
        self._collected = first["collected"]

    def _act(self, inputs: Tensor) -> NDArray[np.floating]:
        actions: NDArray[np.float32] = self._team.run(act, inputs).float().numpy()
        return actions

    def _learn(self) -> None:
        self._update()
        for seed in self._not_finite(LOSS_SUMS):
            self._record_divergence(seed, divergent_loss(self.losses(seed)) or "losses")

    def _not_finite(self, name: str) -> list[int]:
        """Returns the seeds whose tensor `name` is not finite."""
        values = self._saved[name]
        finite = values.isfinite().view(len(values), -1).all(dim=1)
        # Only one small copy from a GPU.
        return [seed for seed, is_finite in enumerate(finite.tolist()) if not is_finite]

    def _still_learning(self, seeds: range) -> bool:
        """Returns whether any of these seeds has not diverged."""
        return not all(seed in self.diverged for seed in seeds)

    @abstractmethod
    def _update(self) -> None:
        """Makes the updates that are due after a rollout."""

    @abstractmethod
    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """Returns the state of the loop for one seed."""

    @abstractmethod
    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """Restores what `_loop_state` returned."""


def act(agent: Learner, observations: Tensor) -> Tensor:
    """Returns an agent's deterministic actions; see `Team.run`."""
    return agent.act(observations)
