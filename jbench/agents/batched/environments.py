"""The simulated robots of all seeds, stepped together."""

from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, chain, pairwise
from typing import NamedTuple

import mujoco
import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.closing import Closing
from jbench.encoders import Encoder, action_signs
from jbench.names import EPISODE_STEPS
from jbench.simulation import Robots
from jbench.tasks import resets
from jbench.tasks.features import TASK_SPECS, State, Target, observation
from jbench.tasks.rewards import reward
from jbench.tasks.robots import load_model

Models = Callable[[int], mujoco.MjModel]
"""Maps an episode number, counted from 0, to its robot."""


class Cell(NamedTuple):
    """Consecutive seeds with the same task and encoder.

    Attributes:
        generators: per seed and environment, of initial poses and targets.
        encoder: of the observations; None for the full observation.
    """

    task: str
    generators: list[Sequence[Generator]]
    encoder: Encoder | None = None

    @property
    def size(self) -> int:
        """Dimension of the agents' inputs."""
        if self.encoder is not None:
            return self.encoder.latent_size
        return TASK_SPECS[self.task].observation_size

    def encode(self, observations: Tensor) -> Tensor:
        """Maps observations (seeds, N, dim(O)) of the task to inputs (seeds, N, size)."""
        if self.encoder is None:
            return observations
        # Seed by seed, because a matrix product may round differently in a larger batch.
        return torch.stack([self.encoder.encode(batch) for batch in observations])

    def action_signs(self, observations: Tensor) -> NDArray[np.float32]:
        """Returns the signs (seeds, N, 1) that map agents' actions to robots' for observations."""
        signs = action_signs(self.encoder, observations)
        if signs is None:
            return np.ones((*observations.shape[:-1], 1), np.float32)
        found: NDArray[np.float32] = signs.numpy()
        return found


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
    """Seeds x environments robots of one or several cells, reset together.

    Use it as a context manager: it holds threads.

    Attributes:
        cells: in the order of their seeds.
        size: largest dimension of the agents' inputs.
        sizes: dimension of each seed's inputs, which are padded with zeros to `size`.
        action_size: numbers in an action.
        observations: (seeds, environments, size) current inputs of the agents, float32.
        episodes: completed episodes of each robot.
        steps: control steps made in the current episode.
    """

    def __init__(
        self,
        cells: Sequence[Cell],
        *,
        threads: int = 1,
        models: Models | None = None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Starts the first episodes.

        Args:
            cells: with the same number of environments per seed.
            models: the robot of each episode; None for the plain robot.
            episode_steps: control steps in an episode; tests use short episodes.
        """
        self.cells, self.threads, self.episode_steps = cells, threads, episode_steps
        self.sizes = [cell.size for cell in cells for _ in cell.generators]
        self.size, self.action_size = max(self.sizes), 1
        self._shape = (len(self.sizes), len(cells[0].generators[0]))
        ends = accumulate((len(cell.generators) * self._shape[1] for cell in cells), initial=0)
        self._rows_of_cells = [slice(*pair) for pair in pairwise(ends)]
        self._models = models or _plain_robot()
        self._model = self._models(0)
        self._robots = self._new_robots()
        self.episodes = self.steps = 0
        self._returns = np.zeros(self._shape)
        self._begin_episodes()

    def close(self) -> None:
        """Stops the threads."""
        self._robots.close()

    def step(self, actions: NDArray[np.floating]) -> Step:
        """Applies the agents' actions (seeds, environments, action_size), clipped to [-1, 1]."""
        state = self._robots.step((actions * self._signs).reshape(-1))
        of_cells = [reward(cell.task, at, target) for cell, at, target in self._by_cell(state)]
        rewards = np.concatenate(of_cells).reshape(self._shape)
        self._returns += rewards
        self.steps += 1
        self.observations = observations = self._observe(state)
        returns = None
        if self.steps == self.episode_steps:
            returns = self._returns
            self.episodes += 1
            self._begin_episodes()
        return Step(rewards, observations, returns)

    def encode(self, observations: Tensor, first: int = 0) -> Tensor:
        """Maps observations of a cell's task to agents' inputs.

        Args:
            observations: (n, N, dim(O)) of the task of consecutive seeds of one cell.
            first: index of the first of these seeds.

        Returns:
            (n, N, size), padded with zeros.
        """
        return self._padded(self._cell(first).encode(observations))

    def action_signs(self, observations: Tensor, first: int = 0) -> NDArray[np.float32]:
        """Returns the signs (n, N, 1) that map agents' actions to robots'; see `encode`."""
        return self._cell(first).action_signs(observations)

    def padding(self, seed: int) -> list[slice]:
        """Returns the columns of a seed's inputs that are padding."""
        return [slice(self.sizes[seed], self.size)] if self.sizes[seed] < self.size else []

    def state(self, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the simulation state of one seed, for `restore`."""
        rows = self._rows(seed)
        return {
            "simulation": self._robots.snapshot(range(rows.start, rows.stop)),
            "target_position": self._target.position[rows].copy(),
            "target_yaw": self._target.yaw[rows].copy(),
            "returns": self._returns[seed].copy(),
        }

    def restore(
        self, seed: int, state: dict[str, NDArray[np.float64]], episodes: int, steps: int
    ) -> None:
        """Restores the simulation of one seed exactly.

        Args:
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
        starts = [
            resets.draw_starts(cell.task, chain.from_iterable(cell.generators))
            for cell in self.cells
        ]
        targets = zip(*(each.targets for each in starts), strict=True)
        self._target = Target(*(np.concatenate(part) for part in targets))
        self._returns = np.zeros(self._shape)
        self.steps = 0
        self.observations = self._observe(
            self._robots.reset(np.concatenate([each.quaternions for each in starts]))
        )

    def _switch_robot(self, episode: int) -> None:
        """Switches to the robot of an episode if it differs from the current one."""
        robot = self._models(episode)
        if robot is not self._model:
            self._robots.close()
            self._model = robot
            self._robots = self._new_robots()

    def _new_robots(self) -> Robots:
        seeds, environments = self._shape
        return Robots(self._model, seeds * environments, self.threads)

    def _observe(self, state: State) -> Tensor:
        """Returns the agents' inputs (seeds, environments, size); notes which are mirrored."""
        of_cells, signs = [], []
        for cell, at, target in self._by_cell(state):
            observed = np.asarray(observation(cell.task, at, target), np.float32)
            seen = torch.from_numpy(observed.reshape(len(cell.generators), self._shape[1], -1))
            of_cells.append(self._padded(cell.encode(seen)))
            signs.append(cell.action_signs(seen))
        self._signs = np.concatenate(signs)
        return of_cells[0] if len(of_cells) == 1 else torch.cat(of_cells)

    def _cell(self, seed: int) -> Cell:
        """Returns the cell of the seed with this index."""
        pairs = zip(self.cells, self._rows_of_cells, strict=True)
        return next(cell for cell, rows in pairs if seed * self._shape[1] < rows.stop)

    def _padded(self, inputs: Tensor) -> Tensor:
        """Returns inputs (..., any) with zeros up to `size`."""
        missing = self.size - inputs.shape[-1]
        return torch.nn.functional.pad(inputs, (0, missing)) if missing else inputs

    def _by_cell(self, state: State) -> Iterator[tuple[Cell, State, Target]]:
        """Yields each cell with the states and targets of its robots."""
        for cell, rows in zip(self.cells, self._rows_of_cells, strict=True):
            states, targets = ((each[rows] for each in part) for part in (state, self._target))
            yield cell, State(*states), Target(*targets)

    def _rows(self, seed: int) -> slice:
        """Returns the indices of a seed's robots."""
        environments = self._shape[1]
        return slice(seed * environments, (seed + 1) * environments)


def _plain_robot() -> Models:
    robot = load_model()
    return lambda episode: robot
