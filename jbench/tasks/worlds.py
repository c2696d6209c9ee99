"""The interface of the worlds in which robots of a task are stepped."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.errors import RequestError, WorkError

if TYPE_CHECKING:
    import mujoco

WorldsState = dict[str, NDArray[Any]]
"""What restores some worlds: arrays by name, each with a row per world."""

Chosen = dict[str, NDArray[np.float64]]
"""What the options of a reset choose: arrays by name, each with a row per world."""


class ModelAndData(NamedTuple):
    """The robot of one world in MuJoCo, and its state."""

    model: "mujoco.MjModel"
    data: "mujoco.MjData"


BY_NUMBERS = "by_numbers"
"""Entry of the summary of work whose episode failed: False if not by its seed and actions."""


def fails_by_numbers(summary: Mapping[str, Any]) -> bool:
    """Returns whether a summary is that of work whose episode failed by its seed and actions."""
    if "episode_failed" not in summary:
        return False
    failed = summary["episode_failed"]
    return not isinstance(failed, Mapping) or failed.get(BY_NUMBERS) is not False


class EpisodeError(WorkError):
    """An episode that can't go on: its environment raised an error, or returned no finite numbers.

    If that was by its numbers, the same seed and actions make the same error, so repeating the work
    is of no use. Files, connections and memory may be there the next time.
    """

    def __init__(
        self, task: str, seed: int, step: int, reason: str, by_numbers: bool = True
    ) -> None:
        """Names the seed of the episode, and its control step, 0 before the first action."""
        failed: dict[str, Any] = {"task": task, "seed": seed, "step": step}
        if not by_numbers:
            failed[BY_NUMBERS] = False

        self.summary = {"episode_failed": failed}
        self._arguments = task, seed, step, reason, by_numbers
        super().__init__(
            f"jbench can't use the task {task}: at control step {step} of the episode with seed "
            f"{seed}, {reason}."
        )

    def with_clause(self, clause: str) -> "EpisodeError":
        """Returns the error with a clause at its end, such as what is kept."""
        task, seed, step, reason, by_numbers = self._arguments
        return EpisodeError(task, seed, step, f"{reason}; {clause}", by_numbers)

    def __reduce__(self) -> tuple[Any, ...]:
        """Makes it again in another process, from its arguments."""
        return EpisodeError, self._arguments


class Worlds(AbstractContextManager["Worlds"]):
    """Robots of one task in separate worlds, stepped together; `reset` begins their episodes.

    A world's numbers depend neither on the other worlds nor on the number of threads. Use it as a
    context manager: it may hold threads.

    Attributes:
        episode_steps: control steps of an episode.
        has_begun: whether the worlds have episodes; they have none before the first reset.
        terminated: (worlds,) whether nothing follows the last state of an episode.
        truncated: (worlds,) whether the task has ended an episode whose last state is not terminal.
        failures: errors of the episodes that can't go on, by world. Such a world is no longer
            stepped: it has its last observation and rewards of 0.
    """

    episode_steps: int
    has_begun: bool = False
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    failures: dict[int, EpisodeError]

    def check(self) -> None:
        """Raises the error of the first world that failed, if there is one."""
        for error in self.failures.values():
            raise error

    def __exit__(self, *_: object) -> None:
        """Closes the worlds."""
        self.close()

    def close(self) -> None:
        """Releases what the worlds hold: nothing by default, since threads end with the object."""

    def reset(
        self, generators: Sequence[Generator], chosen: Chosen | None = None
    ) -> NDArray[np.float32]:
        """Begins an episode in each world and returns the observations (worlds, size).

        All random numbers of a world are drawn from its generator, which others may share, except
        those that are `chosen`, see `begin`.
        """
        return self.begin(range(len(generators)), generators, chosen)

    @abstractmethod
    def begin(
        self,
        worlds: Sequence[int],
        generators: Sequence[Generator],
        chosen: Chosen | None = None,
    ) -> NDArray[np.float32]:
        """Begins an episode in some worlds, each with its generator; the others continue.

        `chosen` takes the place of numbers that are drawn, see `read_options`. Returns the
        observations (worlds, size) of all worlds.
        """

    def read_options(self, options: Mapping[str, Any]) -> Chosen:
        """Returns what the options of an environment's `reset` choose, for `begin`.

        Raises a RequestError if an option does not exist, or its value is wrong.
        """
        if options:
            names = ", ".join(sorted(map(str, options)))
            raise RequestError(f"reset has no option {names}; leave the options out.")
        return {}

    @abstractmethod
    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, action_size), clipped to [-1, 1], for one control step.

        Returns the observations (worlds, size), a new array, and the rewards (worlds,).
        """

    def are_over(self) -> bool:
        """Returns whether the episodes of all worlds have ended before `episode_steps`."""
        return False

    def lengths(self) -> NDArray[np.int64] | int:
        """Returns the control steps of the episodes that have ended, (worlds,) if they differ."""
        return self.episode_steps

    @abstractmethod
    def state(self, rows: slice) -> WorldsState:
        """Returns what `restore` needs of some worlds; within an episode, it may be a WorkError."""

    @abstractmethod
    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Restores what `state` returned; returns the observations (worlds, size) of all worlds."""

    def info(self) -> dict[str, NDArray[np.float64]]:
        """Returns the entries (worlds, ...) of `info` of the present states, as new arrays."""
        return {}

    def physics(self, world: int) -> ModelAndData | None:
        """Returns MuJoCo's model and data of a world for pictures, if it has them.

        Those of `Task.world` are stepped themselves; others may be copies that the next call
        changes.
        """
        return None

    def prepare_pictures(self) -> None:
        """Lets environments without MuJoCo physics draw themselves, before their first episode.

        Raises a RequestError if they can't.
        """

    def picture(self, world: int) -> NDArray[np.uint8] | None:
        """Returns a picture (height, width, 3) that a world without physics draws itself.

        Call `prepare_pictures` before. Raises a RequestError if there is none.
        """
        return None

    def points(self) -> NDArray[np.float32] | None:
        """Returns x, y (m) and heading (rad) of each robot (worlds, 3), if the task has them."""
        return None

    def targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns x, y (m) and yaw (rad) of the targets by name, each (worlds,), if there are any.

        Those in `Task.drawn` are random, the others 0.
        """
        return {}

    def robot_columns(self) -> dict[str, NDArray[np.float32]]:
        """Returns the columns of `policy_states` on the robots, each (worlds,), if any."""
        return {}


class EndingWorlds(Worlds):
    """Worlds whose episodes end on their own, each at its own control step.

    A world whose episode has ended is not stepped until the next one begins: it has its last
    observation and rewards of 0.

    Attributes:
        elapsed: (worlds,) control steps of the current episodes.
        unlike: worlds whose episodes `restore` could not repeat with the same observation.
    """

    elapsed: NDArray[np.int64]
    unlike: set[int]
