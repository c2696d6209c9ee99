"""Episodes of `dm_env` environments, side by side.

They are begun and stepped by the environment's own `reset` and `step`, one world after another:
observation and reward are Python, so threads would be slower. The only state is the seed of an
episode, since many tasks write random targets into their model at each reset.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.errors import WorkError, sentence_of_failure
from jbench.tasks.task import EpisodeError, Task, Worlds, WorldsState

_ROUNDING = 1e-6  # by which rewards may exceed [0, 1]


class EnvironmentTask(Task):
    """What worlds know of a task that `dm_env` environments implement.

    Attributes:
        reseeds: whether an episode reseeds the same environment, instead of making a new one.
        has_unit_rewards: whether all rewards must be in [0, 1].
    """

    reseeds: bool
    has_unit_rewards: bool

    @abstractmethod
    def environment(self, seed: int) -> Any:
        """Returns a new environment; RequestError if it can't be made."""

    @abstractmethod
    def reseed(self, environment: Any, seed: int) -> None:
        """Seeds the next episode of an environment."""

    @abstractmethod
    def commands(self, actions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Maps actions (..., action_size), clipped to [-1, 1], to the actuators' bounds."""


class DmWorlds(Worlds):
    """Environments of one task, stepped one after another."""

    def __init__(self, task: EnvironmentTask, count: int) -> None:
        self._task, self._steps, self.episode_steps = task, 0, task.episode_steps
        self.failures = {}
        self.environments = [task.environment(0) for _ in range(count)]
        self._seeds = np.zeros(count, np.int64)
        self._observations = np.zeros((count, task.observation_size), np.float32)

    def close(self) -> None:
        """Closes the environments."""
        for environment in self.environments:
            close(environment)

    def reset(
        self, generators: Sequence[Generator], yaw: float | None = None
    ) -> NDArray[np.float32]:
        """Begins an episode in each world with a seed of 32 bits from its generator."""
        return self._begin(range(len(generators)), [int(g.integers(2**32)) for g in generators])

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions; a world that is not as in `Task` and `Worlds` fails."""
        self._steps += 1
        rewards = np.zeros(len(self.environments))
        observations = self._observations.copy()
        commands = self._task.commands(actions)
        for i, environment in enumerate(self.environments):
            if i in self.failures:
                continue
            try:
                timestep = environment.step(commands[i])
                rewards[i] = self._read_reward(timestep)
                self._observe(observations[i], timestep.observation)
            except Exception as error:
                observations[i], rewards[i] = self._observations[i], 0.0
                self._fail(i, error)
        self._observations = observations
        return observations, rewards

    def state(self, rows: slice) -> WorldsState:
        """Returns the seeds of the episodes of some worlds, before their first step."""
        if self._steps:
            raise WorkError(f"{self._task.name} has a state between two episodes only.")
        return {"seeds": self._seeds[rows].copy()}

    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Begins the episodes of `state` again in some worlds; returns all observations."""
        worlds = range(rows.start, rows.stop)
        return self._begin(worlds, np.asarray(state["seeds"]).tolist())

    def _begin(self, worlds: Sequence[int], seeds: Sequence[int]) -> NDArray[np.float32]:
        self._steps = 0
        self._observations = self._observations.copy()
        for world, seed in zip(worlds, seeds, strict=True):
            self._seeds[world] = seed
            self.failures.pop(world, None)
            try:
                if self._task.reseeds:
                    self._task.reseed(self.environments[world], seed)
                else:
                    close(self.environments[world])
                    self.environments[world] = self._task.environment(seed)
                timestep = self.environments[world].reset()
                self._observe(self._observations[world], timestep.observation)
            except Exception as error:
                self._observations[world] = 0.0
                self._fail(world, error)
        return self._observations

    def _read_reward(self, timestep: Any) -> float:
        """Returns the reward of a control step, and checks that its episode ends in time."""
        reward = np.nan if timestep.reward is None else float(timestep.reward)
        if not np.isfinite(reward):
            raise _FlawError(f"its reward is {reward}")
        if self._task.has_unit_rewards and not -_ROUNDING <= reward <= 1 + _ROUNDING:
            raise _FlawError(f"its reward is {reward}, not in [0, 1]")
        if timestep.last() and self._steps < self.episode_steps:
            end = "is truncated" if timestep.discount else "terminates"
            raise _FlawError(
                f"its episode {end}, and jbench trains on episodes of one length, here "
                f"{self.episode_steps} control steps: give it a time limit and no other end"
            )
        return reward

    def _observe(self, row: NDArray[np.float32], values: Mapping[str, Any]) -> None:
        """Writes the parts of an observation, flattened in C order, into a row (size,)."""
        lacking = [name for name in self._task.parts if name not in values]
        if lacking:
            raise _FlawError(f"its observation lacks {lacking[0]}")
        parts = [np.ravel(values[name]) for name in self._task.parts]
        if (size := sum(map(len, parts))) != len(row):
            raise _FlawError(f"its observation has {size} values instead of {len(row)}")
        observed = np.empty_like(row)
        np.concatenate(parts, out=observed, casting="same_kind")
        if not np.isfinite(observed).all():
            name = next(n for n, value in values.items() if not np.isfinite(value).all())
            raise _FlawError(f"{name} of its observation is not finite")
        row[:] = observed

    def _fail(self, world: int, error: Exception) -> None:
        reason = str(error)
        if not isinstance(error, _FlawError):
            reason = f"it fails ({' '.join(sentence_of_failure(error).split())})"
        self.failures[world] = EpisodeError(
            self._task.name, int(self._seeds[world]), self._steps, reason
        )


class _FlawError(ValueError):
    """What an environment returned is not as in `Task` and `Worlds`."""


def close(environment: Any) -> None:
    """Closes an environment that can be closed."""
    if callable(close := getattr(environment, "close", None)):
        close()
