"""The simulated robots of all seeds, stepped together."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.closing import Closing
from jbench.encoders import Encoder
from jbench.names import EPISODE_STEPS
from jbench.simulation import Robots
from jbench.tasks import resets
from jbench.tasks.features import TASK_SPECS, State, observation
from jbench.tasks.rewards import reward
from jbench.tasks.robots import load_model

Models = Callable[[int], mujoco.MjModel]
"""Maps an episode number, counted from 0, to its robot."""


class Step(NamedTuple):
    """Result of a control step of all robots.

    Attributes:
        rewards: (seeds, environments).
        observations: (seeds, environments, size) at the end of the step.
        episode_returns: (seeds, environments) of the episodes that ended with this step, or None.
            All episodes end together, and the robots are then reset to their next episodes.
    """

    rewards: NDArray[np.float64]
    observations: Tensor
    episode_returns: NDArray[np.float64] | None


class Environments(Closing):
    """Seeds x environments robots on one task, reset together.

    Use it as a context manager: it holds threads.

    Attributes:
        observations: (seeds, environments, size) current inputs of the agents, float32.
        episodes: completed episodes of each robot.
        steps: control steps made in the current episode.
        episode_steps: control steps in an episode.
        threads: number of simulation threads.
    """

    def __init__(
        self,
        task: str,
        generators: Sequence[Sequence[Generator]],
        *,
        encoder: Encoder | None = None,
        threads: int = 1,
        models: Models | None = None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Starts the first episodes.

        Args:
            generators: per seed and environment, of initial poses and targets.
            models: the robot of each episode; None for the plain robot.
            episode_steps: control steps in an episode; tests use short episodes.
        """
        self._task, self._encoder, self.threads = task, encoder, threads
        self.episode_steps = episode_steps
        self._generators = [generator for seed in generators for generator in seed]
        self._shape = (len(generators), len(generators[0]))
        self._models = models or _plain_robot()
        self._model = self._models(0)
        self._robots = self._new_robots()
        self.episodes = self.steps = 0
        self._returns = np.zeros(self._shape)
        self._begin_episodes()

    def close(self) -> None:
        """Stops the threads."""
        self._robots.close()

    @property
    def size(self) -> int:
        """Dimension of the agents' inputs."""
        if self._encoder is not None:
            return self._encoder.latent_size
        return TASK_SPECS[self._task].observation_size

    def step(self, actions: NDArray[np.floating]) -> Step:
        """Applies actions (seeds, environments), clipped to [-1, 1], for one control step."""
        state = self._robots.step(actions.reshape(-1))
        rewards = np.asarray(reward(self._task, state, self._target)).reshape(self._shape)
        self._returns += rewards
        self.steps += 1
        self.observations = observations = self._observe(state)
        returns = None
        if self.steps == self.episode_steps:
            returns = self._returns
            self.episodes += 1
            self._begin_episodes()
        return Step(rewards, observations, returns)

    def encode(self, observations: Tensor) -> Tensor:
        """Maps observations (seeds, N, dim(O)) of the task to agents' inputs (seeds, N, size)."""
        if self._encoder is None:
            return observations
        # Seed by seed, because a matrix product may round differently in a larger batch.
        return torch.stack([self._encoder.encode(batch) for batch in observations])

    def state(self, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the simulation state of one seed, for `restore`."""
        rows = self._rows(seed)
        return {
            "simulation": self._robots.snapshot()[rows],
            "target_position": self._target.position[rows].copy(),
            "target_yaw": self._target.yaw[rows].copy(),
            "returns": self._returns[seed].copy(),
        }

    def restore(
        self, seed: int, state: dict[str, NDArray[np.float64]], episodes: int, steps: int
    ) -> None:
        """Restores the simulation of one seed exactly.

        Args:
            seed: index of the seed.
            state: from `state`.
            episodes: completed episodes, the same for all seeds.
            steps: control steps made in the current episode, the same for all seeds.
        """
        self._switch_robot(episodes)
        rows = self._rows(seed)
        self._target.position[rows] = state["target_position"]
        self._target.yaw[rows] = state["target_yaw"]
        self._returns[seed] = state["returns"]
        self.episodes, self.steps = episodes, steps
        self.observations = self._observe(
            self._robots.restore(state["simulation"], range(rows.start, rows.stop))
        )

    def _begin_episodes(self) -> None:
        """Resets all robots and draws a target for each."""
        self._switch_robot(self.episodes)
        starts = resets.draw_starts(self._task, self._generators)
        self._target = starts.targets
        self._returns = np.zeros(self._shape)
        self.steps = 0
        self.observations = self._observe(self._robots.reset(starts.quaternions))

    def _switch_robot(self, episode: int) -> None:
        """Switches to the robot of an episode if it differs from the current one."""
        robot = self._models(episode)
        if robot is not self._model:
            self._robots.close()
            self._model = robot
            self._robots = self._new_robots()

    def _new_robots(self) -> Robots:
        return Robots(self._model, len(self._generators), self.threads)

    def _observe(self, state: State) -> Tensor:
        """Returns the agents' inputs (seeds, environments, size)."""
        observed = np.asarray(observation(self._task, state, self._target), np.float32)
        return self.encode(torch.from_numpy(observed.reshape(*self._shape, -1)))

    def _rows(self, seed: int) -> slice:
        """Returns the indices of a seed's robots."""
        environments = self._shape[1]
        return slice(seed * environments, (seed + 1) * environments)


def _plain_robot() -> Models:
    robot = load_model()
    return lambda episode: robot
