"""Robots of all seeds whose episodes end on their own, each at its own control step."""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.agents.environments import Ends, Environments, StepResult
from jbench.tasks.find import find_task
from jbench.tasks.task import EndingWorlds


def make_environments(
    task: str, seeds: Sequence[int], *others: Any, **options: Any
) -> Environments:
    """Returns the environments of a task, whose arguments are those of `Environments`."""
    kind = EndingEnvironments if find_task(task).ends_early else Environments
    return kind(task, seeds, *others, **options)


class EndingEnvironments(Environments):
    """Environments each of which begins its next episode when its own one has ended.

    `episodes` and `steps`, which count episodes that begin together, are 0.
    """

    has_one_length = False
    _worlds: EndingWorlds

    def step(self, actions: NDArray[np.floating]) -> StepResult:
        """See `Environments.step`."""
        worlds = self._worlds
        robot_actions = (actions * self._signs).reshape(-1, self.action_size)
        observations, rewards = worlds.step(robot_actions)
        self._note_failures()
        rewards = rewards.reshape(self._shape)
        self._returns += rewards
        self.observations = inputs = self._inputs(observations)
        is_over = worlds.terminated | worlds.truncated | (worlds.elapsed >= self.episode_steps)
        if not is_over.any():
            return StepResult(rewards, inputs, None)

        ended = is_over.reshape(self._shape)
        ends = Ends(
            ended,
            worlds.terminated.reshape(self._shape).copy(),
            self._returns.copy(),
            worlds.elapsed.reshape(self._shape).copy(),
        )
        self._begin(ended)
        return StepResult(rewards, inputs, ends)

    def truncate_unlike(self) -> StepResult | None:
        """See `Environments.truncate_unlike`."""
        if not self._worlds.unlike:
            return None
        ended = np.zeros(self._shape, bool)
        ended.reshape(-1)[list(self._worlds.unlike)] = True
        ends = Ends(
            ended,
            np.zeros_like(ended),
            self._returns.copy(),
            self._worlds.elapsed.reshape(self._shape).copy(),
        )
        cut = StepResult(np.zeros(self._shape), self.observations, ends)
        self._begin(ended)
        return cut

    def _begin(self, ended: NDArray[np.bool_]) -> None:
        """Begins an episode in some environments (seeds, environments)."""
        worlds = np.flatnonzero(ended).tolist()
        generators = list(chain.from_iterable(seed.environments for seed in self.generators))
        self._returns[ended] = 0.0
        begun = self._worlds.begin(worlds, [generators[world] for world in worlds])
        self.observations = self._inputs(begun)
        self._note_failures()
