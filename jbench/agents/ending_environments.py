"""Robots of all seeds whose episodes end on their own, each at its own control step."""

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from jbench.agents.environments import Ends, Environments, StepResult
from jbench.tasks.find import find_task
from jbench.tasks.worlds import EndingWorlds


def environments_class(task: str) -> type[Environments]:
    """Returns the class of the environments of a task, whose episodes may end early or not."""
    return EndingEnvironments if find_task(task).ends_early else Environments


class EndingEnvironments(Environments):
    """Environments of which each begins its next episode as soon as its own has ended.

    The counts `episodes` and `steps` of episodes that begin together stay 0.
    """

    has_one_length = False
    _worlds: EndingWorlds

    def truncate_unlike(self) -> StepResult | None:
        """See `Environments.truncate_unlike`."""
        if not self._worlds.unlike:
            return None
        ended = np.zeros(self._shape, bool)
        ended.reshape(-1)[list(self._worlds.unlike)] = True
        observations = self.observations
        ends = self._end(ended, np.zeros_like(ended))
        return StepResult(np.zeros(self._shape), observations, ends)

    def _end_episodes(self) -> Ends | None:
        """See `Environments._end_episodes`."""
        worlds = self._worlds
        is_over = worlds.terminated | worlds.truncated | (worlds.elapsed >= self.episode_steps)
        if not is_over.any():
            return None
        return self._end(
            is_over.reshape(self._shape),
            worlds.terminated.reshape(self._shape).copy(),
        )

    def _end(self, ended: NDArray[np.bool_], terminated: NDArray[np.bool_]) -> Ends:
        """Ends episodes (seeds, environments), and begins the next ones."""
        ends = Ends(
            ended,
            terminated,
            self._returns.copy(),
            self._worlds.elapsed.reshape(self._shape).copy(),
        )

        worlds = np.flatnonzero(ended).tolist()
        generators = list(chain.from_iterable(seed.environments for seed in self.generators))
        self._returns[ended] = 0.0
        begun = self._worlds.begin(worlds, [generators[world] for world in worlds])
        self.observations = self._inputs(begun)
        self._note_failures()
        return ends
