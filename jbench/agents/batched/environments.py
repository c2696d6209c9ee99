"""The simulated robots of all seeds, stepped together."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate, chain, pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.closing import Closing
from jbench.encoders import Encoder, action_signs
from jbench.names import EPISODE_STEPS
from jbench.simulation import Worlds, find_task

Augment = Callable[[int], int | None]
"""Maps an episode, counted from 0, to the seed of its augmented robot; None is the plain robot."""


class Cell(NamedTuple):
    """Consecutive seeds with the same task and encoder.

    Attributes:
        generators: per seed and environment, of the episodes' random numbers.
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
        return find_task(self.task).observation_size

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
        cells: in the order of their seeds; their tasks have the same number of actions.
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
        augment: Augment = lambda episode: None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Starts the first episodes.

        Args:
            cells: with the same number of environments per seed.
            augment: the robot of each episode.
            episode_steps: control steps in an episode; tests use short episodes.

        Raises:
            ValueError: if the tasks have different numbers of actions.
        """
        self.cells, self.threads, self.episode_steps = cells, threads, episode_steps
        self.sizes = [cell.size for cell in cells for _ in cell.generators]
        self.size = max(self.sizes)
        self._tasks = [find_task(cell.task) for cell in cells]
        self.action_size = self._tasks[0].action_size
        if any(task.action_size != self.action_size for task in self._tasks):
            names = ", ".join(task.name for task in self._tasks)
            raise ValueError(f"All seeds must have the same number of actions here, not {names}.")
        self._shape = (len(self.sizes), len(cells[0].generators[0]))
        self._firsts = list(accumulate((len(cell.generators) for cell in cells), initial=0))
        # Cells are stepped at the same time, and each by its share of the threads.
        self._pool = ThreadPoolExecutor(len(cells)) if threads > 1 and len(cells) > 1 else None
        self._augment, self._robot = augment, augment(0)
        self._worlds = self._new_worlds()
        self.episodes = self.steps = 0
        self._begin_episodes()

    def close(self) -> None:
        """Stops the threads."""
        for worlds in self._worlds:
            worlds.close()
        if self._pool is not None:
            self._pool.shutdown()

    def step(self, actions: NDArray[np.floating]) -> Step:
        """Applies the agents' actions (seeds, environments, action_size), clipped to [-1, 1]."""
        robot_actions = actions * self._signs
        parts = [
            robot_actions[first:last].reshape(-1, self.action_size)
            for first, last in pairwise(self._firsts)
        ]
        step_all = map if self._pool is None else self._pool.map
        observations, rewards = zip(
            *step_all(lambda worlds, part: worlds.step(part), self._worlds, parts), strict=True
        )
        self._returns += (reward := np.concatenate(rewards).reshape(self._shape))
        self.steps += 1
        self.observations = inputs = self._inputs(observations)
        returns = None
        if self.steps == self.episode_steps:
            returns = self._returns
            self.episodes += 1
            self._begin_episodes()
        return Step(reward, inputs, returns)

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

    def state(self, seed: int) -> dict[str, NDArray[Any]]:
        """Returns the simulation state of one seed, for `restore`; see `Worlds.state`."""
        cell, rows = self._place(seed)
        return {**self._worlds[cell].state(rows), "returns": self._returns[seed].copy()}

    def restore(self, seed: int, state: dict[str, NDArray[Any]], episodes: int, steps: int) -> None:
        """Restores the simulation of one seed exactly.

        Args:
            episodes: completed episodes, the same for all seeds.
            steps: control steps made in the current episode, the same for all seeds.
        """
        self._switch_robot(episodes)
        cell, rows = self._place(seed)
        self._returns[seed] = state["returns"]
        self.episodes, self.steps = episodes, steps
        self._seen[cell] = self._worlds[cell].restore(rows, state)
        self.observations = self._inputs(self._seen)

    def _begin_episodes(self) -> None:
        """Begins an episode of each robot."""
        self._switch_robot(self.episodes)
        self._returns = np.zeros(self._shape)
        self.steps = 0
        self.observations = self._inputs(
            [
                worlds.reset(list(chain.from_iterable(cell.generators)))
                for cell, worlds in zip(self.cells, self._worlds, strict=True)
            ]
        )

    def _switch_robot(self, episode: int) -> None:
        """Switches to the robot of an episode if it differs from the current one."""
        robot = self._augment(episode)
        if robot != self._robot:
            for worlds in self._worlds:
                worlds.close()
            self._robot = robot
            self._worlds = self._new_worlds()

    def _new_worlds(self) -> list[Worlds]:
        threads = -(-self.threads // len(self.cells))
        return [
            task.worlds(len(cell.generators) * self._shape[1], threads, self._robot)
            for task, cell in zip(self._tasks, self.cells, strict=True)
        ]

    def _inputs(self, observations: Sequence[NDArray[np.float32]]) -> Tensor:
        """Returns the agents' inputs (seeds, environments, size); notes which are mirrored.

        Args:
            observations: (robots, dim(O)) of each cell.
        """
        self._seen, of_cells, signs = list(observations), [], []
        for cell, observed in zip(self.cells, observations, strict=True):
            seen = torch.from_numpy(observed.reshape(len(cell.generators), self._shape[1], -1))
            of_cells.append(self._padded(cell.encode(seen)))
            signs.append(cell.action_signs(seen))
        self._signs = np.concatenate(signs)
        return of_cells[0] if len(of_cells) == 1 else torch.cat(of_cells)

    def _cell(self, seed: int) -> Cell:
        """Returns the cell of the seed with this index."""
        return self.cells[self._place(seed)[0]]

    def _place(self, seed: int) -> tuple[int, slice]:
        """Returns the index of a seed's cell, and its robots among those of the cell."""
        cell = next(i for i, last in enumerate(self._firsts[1:]) if seed < last)
        first = (seed - self._firsts[cell]) * self._shape[1]
        return cell, slice(first, first + self._shape[1])

    def _padded(self, inputs: Tensor) -> Tensor:
        """Returns inputs (..., any) with zeros up to `size`."""
        missing = self.size - inputs.shape[-1]
        return torch.nn.functional.pad(inputs, (0, missing)) if missing else inputs
