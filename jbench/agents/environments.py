"""The simulated robots of all seeds, stepped together, and the random generators of each seed."""

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.random import PCG64, Generator, SeedSequence
from numpy.typing import NDArray
from torch import Tensor

from jbench.closing import closed_on_error
from jbench.encoders import Encoder, action_signs
from jbench.tasks.find import find_task
from jbench.tasks.worlds import EpisodeError, Worlds

Augment = Callable[[int], int | None]
"""Maps an episode, counted from 0, to the seed of its augmented robot; None is the plain robot."""

_WORLD = "environments/"  # prefix of the tensors of the robots in a state


class Generators:
    """The random generators of one seed, independent of the other seeds.

    They are on the CPU for every device, so an agent on a GPU sees the same robots, minibatches
    and noise as on a CPU.

    Attributes:
        actions: draws exploration noise.
        updates: draws minibatches, and the noise in them.
        environments: draw the initial states, one for each environment.
    """

    def __init__(self, seed: int, environments: int) -> None:
        """Spawns independent generators from one seed, one for each use."""
        self.seed = seed
        weights, actions, updates, *others = SeedSequence(seed).spawn(3 + environments)
        self._weights = weights
        self.actions = Generator(PCG64(actions))
        self.updates = Generator(PCG64(updates))
        self.environments = [Generator(PCG64(other)) for other in others]

    def weights(self) -> torch.Generator:
        """Returns a new generator of the initial weights."""
        return torch.Generator().manual_seed(int(self._weights.generate_state(1, np.uint64)[0]))

    def all(self) -> list[Generator]:
        """Returns the generators whose states are part of a checkpoint."""
        return [self.actions, self.updates, *self.environments]


class SeedState(NamedTuple):
    """The state of one seed, except for its replay buffer."""

    tensors: dict[str, Tensor]  # by name, on the CPU, without shared memory (safetensors)
    scalars: dict[str, Any]  # everything else, serialisable as JSON


def under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Returns the tensors whose names start with a prefix, with the prefix removed."""
    return {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }


class Ends(NamedTuple):
    """The episodes that ended with a control step; arrays are (seeds, environments).

    Attributes:
        ended: whether the episode of an environment has ended.
        terminated: whether it has ended in a terminal state, not by truncation.
        returns: of the episodes, also of those that go on.
        lengths: control steps of the episodes, also of those that go on.
    """

    ended: NDArray[np.bool_]
    terminated: NDArray[np.bool_]
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]


class StepResult(NamedTuple):
    """Result of a control step of all robots."""

    rewards: NDArray[np.float64]  # (seeds, environments)
    observations: Tensor  # (seeds, environments, size) at the end of the step
    ends: Ends | None  # None if no episode ended


class Environments:
    """Seeds x environments robots of a task whose episodes have one length, reset together.

    Close them in the end: they hold threads.

    Attributes:
        size: numbers in an input of an agent, latents if it has an encoder.
        action_size: numbers in an action.
        generators: of each seed.
        observations: (seeds, environments, size) the current inputs of the agents, in float32.
        episodes: that each environment has completed.
        steps: of the current episodes.
        failures: the first error of an episode that could not go on, by seed; other seeds go on.
    """

    has_one_length = True

    def __init__(
        self,
        task: str,
        seeds: Sequence[int],
        count: int = 1,
        encoders: Sequence[Encoder | None] | None = None,
        *,
        threads: int = 1,
        augment: Augment = lambda episode: None,
        episode_steps: int | None = None,
    ) -> None:
        """Starts the first episodes; all encoders must have the same number of latents.

        `episode_steps` may be shorter than the task's episodes, which are the default.
        """
        self.task = task
        self.threads = threads
        self.encoders = encoders or [None] * len(seeds)
        self.generators = [Generators(seed, count) for seed in seeds]
        self._task = find_task(task)
        self._shape = (len(seeds), count)
        self.episode_steps = episode_steps or self._task.episode_steps
        self.action_size = self._task.action_size
        full = self._task.observation_size
        (self.size,) = {
            full if encoder is None else encoder.latent_size for encoder in self.encoders
        }
        first, *others = self.encoders
        is_shared = getattr(first, "is_rowwise", False) and all(other is first for other in others)
        self._shared = first if is_shared else None
        blank = torch.zeros(1, full)
        self._mirrors = any(action_signs(encoder, blank) is not None for encoder in self.encoders)
        self._augment = augment
        self._robot = augment(0)
        self._worlds = self._new_worlds()
        self.failures: dict[int, EpisodeError] = {}
        self.episodes = 0
        self.steps = 0
        with closed_on_error(self._worlds):
            self._begin_episodes()

    def close(self) -> None:
        """Stops the threads."""
        self._worlds.close()

    def step(self, actions: NDArray[np.floating]) -> StepResult:
        """Applies the agents' actions (seeds, environments, action_size), clipped to [-1, 1]."""
        robot_actions = (actions * self._signs).reshape(-1, self.action_size)
        observations, rewards = self._worlds.step(robot_actions)
        self._note_failures()
        rewards = rewards.reshape(self._shape)
        self._returns += rewards
        inputs = self._inputs(observations)
        self.observations = inputs
        return StepResult(rewards, inputs, self._end_episodes())

    def encode(self, observations: Tensor) -> Tensor:
        """Maps observations (seeds, N, dim(O)) of the task to inputs (seeds, N, size)."""
        if all(encoder is None for encoder in self.encoders):
            return observations
        if self._shared is not None:  # with the same bits as seed by seed
            inputs: Tensor = self._shared.encode(observations)
            return inputs

        # Seed by seed, because a matrix product may round differently in a larger batch.
        pairs = zip(self.encoders, observations, strict=True)
        return torch.stack(
            [seen if encoder is None else encoder.encode(seen) for encoder, seen in pairs]
        )

    def action_signs(self, observations: Tensor) -> NDArray[np.float32]:
        """Returns the signs (seeds, N, 1) that map agents' actions to robots' for observations."""
        signs = np.ones((*observations.shape[:-1], 1), np.float32)
        if not self._mirrors:
            return signs
        if self._shared is not None:
            return np.asarray(action_signs(self._shared, observations))

        for seed, encoder in enumerate(self.encoders):
            mirrored = action_signs(encoder, observations[seed])
            if mirrored is not None:
                signs[seed] = mirrored
        return signs

    def state(self, seed: int) -> SeedState:
        """Returns the state of one seed's robots and generators; see `Worlds.state`."""
        arrays = {**self._worlds.state(self._places(seed)), "returns": self._returns[seed].copy()}
        streams = [dict(generator.bit_generator.state) for generator in self.generators[seed].all()]
        scalars = {"episodes": self.episodes, "episode_steps": self.steps, "streams": streams}
        tensors = {f"{_WORLD}{name}": torch.from_numpy(array) for name, array in arrays.items()}
        return SeedState(tensors, scalars)

    def restore(self, seed: int, state: SeedState) -> None:
        """Restores one seed exactly; numbers of episodes and their steps are those of all seeds."""
        scalars = state.scalars
        world = {name: tensor.numpy() for name, tensor in under(_WORLD, state.tensors).items()}
        self._switch_robot(scalars["episodes"])
        self._returns[seed] = world["returns"]
        self.episodes = scalars["episodes"]
        self.steps = scalars["episode_steps"]
        self.observations = self._inputs(self._worlds.restore(self._places(seed), world))
        for generator, saved in zip(self.generators[seed].all(), scalars["streams"], strict=True):
            generator.bit_generator.state = saved

    def skip(self, episodes: int) -> None:
        """Leaves out this many episodes of each environment, of which no step is made."""
        for _ in range(episodes):
            self._begin_episodes()

    def truncate_unlike(self) -> StepResult | None:
        """Truncates the episodes that `restore` could not repeat, and begins others.

        Returns what ended, with rewards of 0, or None if all continue, as episodes of one length
        do.
        """
        return None

    def _end_episodes(self) -> Ends | None:
        """Returns which episodes have just ended, None if none has, and begins the next ones."""
        self.steps += 1
        if self.steps != self.episode_steps:
            return None
        every = np.ones(self._shape, bool)
        ends = Ends(every, ~every, self._returns, np.full(self._shape, self.steps))
        self.episodes += 1
        self._begin_episodes()
        return ends

    def _begin_episodes(self) -> None:
        """Starts an episode in every world, on the robot of its number."""
        self._switch_robot(self.episodes)
        self._returns = np.zeros(self._shape)
        self.steps = 0
        generators = chain.from_iterable(seed.environments for seed in self.generators)
        self.observations = self._inputs(self._worlds.reset(list(generators)))
        self._note_failures()

    def _note_failures(self) -> None:
        """Notes the first error of the worlds of each seed."""
        for world, error in self._worlds.failures.items():
            self.failures.setdefault(world // self._shape[1], error)

    def _switch_robot(self, episode: int) -> None:
        """Makes the worlds again if the episode is on another robot of the sequence."""
        robot = self._augment(episode)
        if robot != self._robot:
            self._worlds.close()
            self._robot = robot
            self._worlds = self._new_worlds()

    def _new_worlds(self) -> Worlds:
        """Returns worlds of the present robot, as many as all seeds have environments."""
        return self._task.worlds(self._shape[0] * self._shape[1], self.threads, self._robot)

    def _inputs(self, observations: NDArray[np.float32]) -> Tensor:
        """Returns the agents' inputs (seeds, environments, size); notes which are mirrored."""
        seen = torch.from_numpy(observations.reshape(*self._shape, -1))
        self._signs = self.action_signs(seen)
        return self.encode(seen)

    def _places(self, seed: int) -> slice:
        """Returns the places of a seed's worlds."""
        return slice(seed * self._shape[1], (seed + 1) * self._shape[1])
