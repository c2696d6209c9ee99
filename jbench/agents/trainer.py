"""What trains the agents of a batch of runs."""

from collections.abc import Iterator, Sequence
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.engine import SeedState
from jbench.agents.batched.environments import Environments
from jbench.agents.divergence import Divergence
from jbench.policies.network import Network
from jbench.policies.saved import Policy


class Trainer(Protocol):
    """The batched engine, or the loop of a plug-in agent; see `Engine` for its methods.

    Attributes:
        control_steps: per seed, over all its environments.
        diverged: the diverged seeds by index.
    """

    control_steps: int
    diverged: dict[int, Divergence]

    @property
    def environments(self) -> Environments:
        """The robots of all seeds."""

    @property
    def updates(self) -> int | None:
        """Number of updates per seed; None if unknown."""

    @property
    def is_resumable(self) -> bool:
        """Whether there are `state` and `restore`."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def learn(self, steps: int) -> Iterator[NDArray[np.float64] | None]:
        """Trains each seed for `steps` control steps; yields after each of them."""

    def act(self, observations: NDArray[np.float32], first: int = 0) -> NDArray[np.floating]:
        """Returns deterministic actions of seeds of a cell for their task's observations."""

    def policy(self, seed: int) -> Policy | Network | None:
        """Returns a copy of a deterministic policy; None if the agent has none to be saved."""

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses of a seed by database name."""

    def check_weights(self) -> None:
        """Records in `diverged` the seeds whose weights are not finite."""

    def state(self, seed: int) -> SeedState:
        """Returns the state of one seed, without the rows of a replay buffer of ours."""

    def restore(self, states: Sequence[SeedState]) -> None:
        """Restores all seeds."""
