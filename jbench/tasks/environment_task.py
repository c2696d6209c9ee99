"""Tasks of environments of others: their episodes, and what is tried of them."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError, WorkError
from jbench.tasks.environment_maker import EnvironmentMaker
from jbench.tasks.environment_worlds import EnvironmentWorlds
from jbench.tasks.task import DOES_NOT_REPEAT, rollout
from jbench.tasks.worlds import Worlds

_SEEDS_TRIED = 10
"""Most seeds whose episodes must have the time limit that was measured."""

_STEPS_TRIED = 20_000
"""Control steps of these episodes, so that trying a task takes seconds."""


class EnvironmentTask(EnvironmentMaker):
    """A task whose environment is a `dm_env.Environment` or a `gymnasium.Env` of others."""

    def worlds(
        self,
        count: int,
        threads: int = 1,
        augment: int | None = None,
        *,
        vary_masses: bool = False,
    ) -> EnvironmentWorlds:
        """Returns new worlds; see `Task.worlds`. They are stepped in the caller's thread."""
        if augment is not None or vary_masses:
            raise self._refusal("it has no augmented robots; leave them out")
        return EnvironmentWorlds(self, count)

    @cached_property
    def _has_repeated(self) -> bool:
        """Whether an episode of random actions was the same twice; WorkError if it fails."""
        with self.worlds(1) as worlds:
            once = self._random_episode(worlds)
            again = self._random_episode(worlds)
        return all(map(np.array_equal, once, again))

    def repeats(self) -> bool:
        """See `Task.repeats`; dm_control's suite is not tried."""
        if self.is_of_suite:
            return True
        try:
            return self._has_repeated
        except WorkError:  # the work that asks will meet the error itself
            return True

    def check(self) -> None:
        """Runs an episode of random actions twice; notes if it does not repeat.

        An episode that is not as in `Task` is a RequestError. So is a measured time limit that is
        not the one of all episodes, as far as some of other seeds show it, and a function that
        returns one environment again and again.
        """
        self._try_to_make_two()
        try:
            has_repeated = self._has_repeated
            if self.limit_advice is not None:
                self._try_other_seeds()
        except WorkError as error:
            raise RequestError(str(error)) from None
        if not has_repeated:
            self.notes += (DOES_NOT_REPEAT,)

    def _try_to_make_two(self) -> None:
        """Raises a RequestError if a user's function returns the same environment twice."""
        if self.is_of_suite:
            return

        worlds = self.worlds(2)
        with worlds:
            # Training and evaluations would step the same episode.
            first, second = (getattr(made, "env", made) for made in worlds.environments)
            if first is second:
                raise self._refusal(
                    "its function returns the same environment again; let it make a new one at "
                    "each call"
                )

    def _try_other_seeds(self) -> None:
        """Makes episodes of other seeds; a WorkError if one can't go on.

        Their commands are those of the episode that was measured, by which it did not terminate.
        """
        episodes = np.clip(_STEPS_TRIED // self.episode_steps, 1, _SEEDS_TRIED)
        actions = np.zeros((1, self.action_size))
        with self.worlds(1) as worlds:
            for seed in range(1, episodes + 1):
                observations = worlds.reset([np.random.default_rng(seed)])
                for _ in rollout(worlds, observations, lambda _: actions):
                    worlds.check()

    def _random_episode(self, worlds: Worlds) -> tuple[NDArray[Any], NDArray[Any]]:
        """Returns what an episode of random actions has.

        These are its observations (steps + 1, size) and its rewards (steps, 1).
        """
        random = np.random.default_rng(0)
        shape = (1, self.action_size)
        seen = [worlds.reset([random])]
        rewards = []
        worlds.check()

        for step in rollout(worlds, seen[0], lambda _: random.uniform(-1, 1, shape)):
            worlds.check()
            seen.append(step.next_observations)
            rewards.append(step.rewards)

        return np.concatenate(seen), np.stack(rewards)
