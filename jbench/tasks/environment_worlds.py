"""Episodes of the environments of an `EnvironmentTask`, side by side.

They are begun and stepped by the environment's own `reset` and `step`, one world after another:
observation and reward are Python, so threads would be slower. The state of an episode is its seed
and the actions so far, since many tasks write random targets into their model at each reset.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.closing import make_all
from jbench.errors import ERRORS_OF_OTHERS, WorkError, sentence_of_failure
from jbench.tasks.environment_maker import EnvironmentMaker
from jbench.tasks.environment_specification import UnusableError
from jbench.tasks.own_pictures import check_can_draw, check_draws, mujoco_physics, own_picture
from jbench.tasks.time_steps import FlawError, TimeStepReader
from jbench.tasks.worlds import Chosen, EndingWorlds, EpisodeError, ModelAndData, WorldsState


class EnvironmentWorlds(EndingWorlds):
    """Environments of one task, stepped one after another."""

    def __init__(self, task: EnvironmentMaker, count: int, *, draws: bool = False) -> None:
        """Makes the environments, which have no episode yet, and may draw themselves."""
        self._task = task
        self._reader = TimeStepReader(task)
        self._draws = draws
        self.episode_steps = task.episode_steps
        self.failures = {}
        self.unlike = set()
        self.environments = _new_environments(task, count, draws=draws)
        self.elapsed = np.zeros(count, np.int64)
        self.terminated = np.zeros(count, bool)
        self.truncated = np.zeros(count, bool)
        self._seeds = np.zeros(count, np.int64)
        self._observations = np.zeros((count, task.observation_size), np.float32)
        # The commands of the current episodes, by which they can be repeated.
        self._commands: list[list[NDArray[np.float64]]] = [[] for _ in range(count)]

    def close(self) -> None:
        """Closes the environments."""
        for environment in self.environments:
            self._task.close_environment(environment)

    def begin(
        self,
        worlds: Sequence[int],
        generators: Sequence[Generator],
        chosen: Chosen | None = None,
    ) -> NDArray[np.float32]:
        """See `Worlds.begin`; an episode has a seed of 32 bits from its generator."""
        self.has_begun = True
        self._observations = self._observations.copy()
        for world, generator in zip(worlds, generators, strict=True):
            self._begin(world, int(generator.integers(2**32)))

        return self._observations

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions; a world that is not as in `Task` and `Worlds` fails."""
        rewards = np.zeros(len(self.environments))
        self._observations = self._observations.copy()
        commands = self._task.commands(actions)
        for world in range(len(self.environments)):
            if not self._is_over(world):
                rewards[world] = self._step(world, commands[world])

        return self._observations, rewards

    def are_over(self) -> bool:
        """See `Worlds.are_over`."""
        return all(self._is_over(world) for world in range(len(self.environments)))

    def lengths(self) -> NDArray[np.int64]:
        """See `Worlds.lengths`."""
        return self.elapsed.copy()

    def state(self, rows: slice) -> WorldsState:
        """Returns the seeds and commands of the episodes of some worlds, and what they observe."""
        if not self._task.has_state_within_episode and self.elapsed[rows].any():
            raise WorkError(f"{self._task.name} has a state between two episodes only.")

        seeds = self._seeds[rows].copy()
        if not self._task.has_state_within_episode:
            return {"seeds": seeds}

        elapsed = self.elapsed[rows].copy()
        commands = np.zeros((len(seeds), elapsed.max(), self._task.action_size))
        for row, made in zip(commands, self._commands[rows], strict=True):
            row[: len(made)] = np.reshape(made, (len(made), self._task.action_size))

        return {
            "seeds": seeds,
            "elapsed": elapsed,
            "commands": commands,
            "observations": self._observations[rows].copy(),
        }

    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Repeats the episodes of `state` in some worlds; returns all observations.

        A world whose observation or end is then another one is in `unlike`. It has the observation
        of `state`, and needs a new episode. An episode of which no step was made is begun again,
        and whatever it observes first is its beginning.
        """
        self.has_begun = True
        self._observations = self._observations.copy()
        seeds = state["seeds"].tolist()
        for row, world in enumerate(range(rows.start, rows.stop)):
            self._begin(world, seeds[row])
            elapsed = int(state["elapsed"][row]) if "elapsed" in state else 0
            if elapsed:
                commands = state["commands"][row, :elapsed]
                self._repeat(world, commands, state["observations"][row])

        return self._observations

    def _repeat(
        self, world: int, commands: NDArray[np.float64], observed: NDArray[np.float32]
    ) -> None:
        """Applies the commands (steps, action_size) of an episode again in a world.

        The world is in `unlike` if it then does not observe `observed`, or its episode is over.
        """
        for command in commands:
            self._step(world, command)

        is_alike = np.array_equal(self._observations[world], observed)
        if self._is_over(world) or self.elapsed[world] != len(commands) or not is_alike:
            self.failures.pop(world, None)
            self.unlike.add(world)
            self.elapsed[world] = len(commands)
            self._observations[world] = observed

    def physics(self, world: int) -> ModelAndData | None:
        """Returns the model and data of an environment that has a MuJoCo physics."""
        return mujoco_physics(self.environments[world])

    def prepare_pictures(self) -> None:
        """See `Worlds.prepare_pictures`: the environments are made again."""
        check_can_draw(self._task.name, self.environments[0])
        count = len(self.environments)
        self.close()
        self.environments = []  # none is left to close if the next ones can't be made
        self._draws = True
        self.environments = _new_environments(self._task, count, draws=True)
        check_draws(self._task.name, self.environments[0])

    def picture(self, world: int) -> NDArray[np.uint8]:
        """See `Worlds.picture`."""
        return own_picture(self._task.name, self.environments[world])

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns how a copy is made, which has no episode before its first reset."""
        return partial(EnvironmentWorlds, draws=self._draws), (self._task, len(self.environments))

    def _is_over(self, world: int) -> bool:
        """Returns whether a world is not stepped until its next episode."""
        ended = bool(self.terminated[world] or self.truncated[world])
        return ended or world in self.failures

    def _begin(self, world: int, seed: int) -> None:
        """Begins the episode of a seed in a world, which fails if its environment does."""
        self._seeds[world] = seed
        self._commands[world] = []
        self.elapsed[world] = 0
        self.terminated[world] = False
        self.truncated[world] = False
        self.failures.pop(world, None)
        self.unlike.discard(world)

        try:
            if self._task.reseeds:
                self._task.reseed(self.environments[world], seed)
            else:
                self._task.close_environment(self.environments[world])
                self.environments[world] = self._task.environment(seed, draws=self._draws)

            timestep = self.environments[world].reset()
            self._reader.observation(self._observations[world], timestep.observation)
        except ERRORS_OF_OTHERS as error:
            self._observations[world] = 0.0
            self._fail(world, error)

    def _step(self, world: int, command: NDArray[np.float64]) -> float:
        """Applies a command (action_size,) to a world; returns its reward, 0 if it fails."""
        self.elapsed[world] += 1
        self._commands[world].append(command)
        try:
            timestep = self.environments[world].step(command.copy())
            reward = self._reader.reward(timestep)
            self._reader.observation(self._observations[world], timestep.observation)
            end = self._reader.end(timestep, int(self.elapsed[world]))
        except ERRORS_OF_OTHERS as error:
            self._fail(world, error)
            return 0.0

        self.terminated[world] = end.is_terminated
        self.truncated[world] = end.is_truncated
        return reward

    def _fail(self, world: int, error: BaseException) -> None:
        """Notes why the episode of a world can't go on."""
        reason = str(error)
        if not isinstance(error, FlawError | UnusableError):
            reason = f"it fails ({sentence_of_failure(error)})"
        self.failures[world] = EpisodeError(
            self._task.name,
            int(self._seeds[world]),
            int(self.elapsed[world]),
            reason,
            by_numbers=not isinstance(error, OSError | MemoryError),
        )


def _new_environments(task: EnvironmentMaker, count: int, *, draws: bool) -> list[Any]:
    """Returns environments of a task; if one can't be made, those before it are closed."""
    return make_all(count, partial(task.environment, 0, draws=draws), task.close_environment)
