"""The training loop of jbench: several seeds, side by side."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.divergence import DivergedError
from jbench.agents.environments import Ends, Environments, SeedState, StepResult
from jbench.policies.network import SavedNetwork
from jbench.tasks.worlds import EpisodeError
from jbench.timing import part

AfterStep = Callable[[Ends | None], bool]
"""Called after a control step with the episodes that ended; returns whether to go on."""

CPU = torch.device("cpu")


class TrainingLoop(AbstractContextManager["TrainingLoop"]):
    """An `Engine` that steps the robots of several seeds; each learns what it would learn alone.

    Use it as a context manager: it holds threads.

    Attributes:
        environments: the robots of all seeds.
        control_steps: of each seed so far, over its environments.
        updates: of each seed so far; None if unknown.
        diverged: the seeds that have diverged, by index. Actions of theirs that are not finite
            become 0; the other seeds are not affected.
        truncated_at_restore: see `Engine`.
    """

    updates: int | None = None

    def __init__(self, environments: Environments, rollout_steps: int = 1) -> None:
        """Starts with untrained agents, which learn every `rollout_steps` of each environment."""
        self.environments = environments
        self.control_steps = 0
        self.diverged: dict[int, DivergedError] = {}
        self.truncated_at_restore: Ends | None = None
        self._rollout_steps = rollout_steps
        self._collected = 0

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the threads."""
        self.environments.close()

    def learn(self, steps: int) -> Iterator[Ends | None]:
        """Trains until each seed has made `steps` control steps and completed a rollout.

        Steps are counted from the start of training. Learning happens when the step after a
        completed rollout is requested, also after `restore`, so the caller can evaluate or save the
        agents between any two steps. Yields after each step of all robots the episodes that ended
        with it, or None.
        """
        while True:
            if self._collected == self._rollout_steps:
                with part("updates"):
                    self._after_rollout()
                self._collected = 0
            if self._collected == 0 and self.control_steps >= steps:
                break
            observations = self.environments.observations
            with part("acting"):
                actions = self._checked_actions(self._explore_actions(observations))
            with part("robots"):
                step = self.environments.step(actions)
            self.control_steps += actions.shape[1]
            self._collected += 1
            with part("transitions"):
                self._store(observations, actions, step)
            yield step.ends

    def train(self, steps: int, after_step: AfterStep) -> None:
        """Trains as `learn` does, until `after_step` returns False."""
        for ends in self.learn(steps):
            if not after_step(ends):
                break

    def has_made(self, steps: int) -> bool:
        """Returns whether `learn` makes no more control steps, but for the last updates."""
        return self.control_steps >= steps and self._collected in (0, self._rollout_steps)

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns deterministic actions (..., dim(A)) in [-1, 1]; 0 for diverged agents.

        The observations (..., dim(O)) are those of the task, not encoded, as many for each seed.
        """
        per_seed = len(self.environments.generators), -1, observations.shape[-1]
        seen = torch.from_numpy(observations.reshape(per_seed))
        actions = self._act(self.environments.encode(seen))
        actions[list(self.diverged)] = 0
        robot_actions: NDArray[np.floating] = actions * self.environments.action_signs(seen)
        return robot_actions.reshape(*observations.shape[:-1], -1)

    @property
    def failures(self) -> Mapping[int, EpisodeError]:
        """See `Engine.failures`."""
        return self.environments.failures

    def _truncate_unlike(self) -> None:
        """Truncates the episodes that could not be repeated, after all seeds are restored."""
        step = self.environments.truncate_unlike()
        if step is not None:
            self.truncated_at_restore = step.ends
            self._truncate(step)

    def _truncate(self, step: StepResult) -> None:
        """Notes the truncation of the last transitions of the environments that `step` ended."""

    @property
    def threads(self) -> int:
        """See `Engine.threads`."""
        return self.environments.threads

    @abstractmethod
    def policy(self, seed: int) -> SavedNetwork | None:
        """Returns a copy of the deterministic policy of the seed with this index, if there is one.

        Raises:
            UnsupportedPolicyError: if it is not a sequence of supported layers.
        """

    @abstractmethod
    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses of a seed by database name; empty before the first update."""

    @abstractmethod
    def check_weights(self) -> None:
        """Records in `diverged` the seeds whose weights or optimizer moments are not finite."""

    @abstractmethod
    def state(self, seed: int) -> SeedState | None:
        """Returns the state of one seed without its replay rows, at any control step.

        None if its agent has none that can be restored.
        """

    @abstractmethod
    def restore(self, states: Sequence[SeedState]) -> None:
        """Restores all seeds; on a CPU, training continues with the same bits.

        The replay rows of an off-policy engine must be restored before.
        """

    def _record_divergence(self, seed: int, what: str) -> None:
        """Notes when a seed diverged and by what; later ones change nothing."""
        self.diverged.setdefault(seed, DivergedError(self.updates, self.control_steps, what))

    def _checked_actions(self, actions: NDArray[np.floating]) -> NDArray[np.floating]:
        """Replaces actions that are not finite by 0, as MuJoCo would with a warning; notes it."""
        finite = np.isfinite(actions).all(axis=(1, 2))
        if not finite.all():
            for seed in np.flatnonzero(~finite).tolist():
                self._record_divergence(seed, "actions")
            actions[~finite] = 0
        return actions

    @abstractmethod
    def _act(self, inputs: Tensor) -> NDArray[np.floating]:
        """Returns deterministic actions (seeds, N, action_size) for inputs (seeds, N, size)."""

    @abstractmethod
    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        """Returns exploring actions (seeds, environments, action_size)."""

    @abstractmethod
    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        """Stores the transitions of a control step."""

    def _after_rollout(self) -> None:
        """Makes the updates that are due after a rollout."""
