"""Engines, which train the agents of one or several runs, whoever wrote their algorithm."""

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.divergence import DivergedError
from jbench.agents.environments import Ends, SeedState
from jbench.agents.training_loop import AfterStep
from jbench.policies.network import SavedNetwork
from jbench.tasks.worlds import EpisodeError


class Engine(Protocol):
    """Trains an agent for each of some seeds; a context manager, which ends its threads.

    A method that takes `seed` takes the index of a seed among these.
    """

    @property
    def control_steps(self) -> int:
        """Control steps of each seed so far, over its environments."""

    @property
    def updates(self) -> int | None:
        """Updates of each seed so far; None if unknown."""

    @property
    def threads(self) -> int:
        """Threads that step the robots, for evaluations as well."""

    @property
    def diverged(self) -> Mapping[int, DivergedError]:
        """The seeds whose agents have diverged."""

    @property
    def failures(self) -> Mapping[int, EpisodeError]:
        """The errors that stopped the episode of a seed, and with it its training, by seed."""

    @property
    def truncated_at_restore(self) -> Ends | None:
        """The episodes that `restore` has truncated, since it could not repeat them."""

    @property
    def replay(self) -> ReplayBuffer | None:
        """The replay buffers of all seeds, if a checkpoint must contain them."""

    def train(self, steps: int, after_step: AfterStep) -> None:
        """Trains until `steps` control steps are made, or `after_step` returns False."""

    def has_made(self, steps: int) -> bool:
        """Returns whether these control steps are made, but for the last updates."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns deterministic actions (..., dim(A)) for observations (..., dim(O)) of the task.

        There are as many observations for each seed.
        """

    def policy(self, seed: int) -> SavedNetwork | None:
        """Returns a copy of a deterministic policy, if there is one."""

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses by database name; empty before the first update."""

    def check_weights(self) -> None:
        """Notes in `diverged` the seeds whose weights are not finite."""

    def state(self, seed: int) -> SeedState | None:
        """Returns the state without the replay buffer; None if a killed run must start over."""

    def restore(self, states: Sequence[SeedState]) -> None:
        """Restores the states of all seeds; their replay buffers are restored before."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
        /,
    ) -> Any: ...
