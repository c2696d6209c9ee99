"""The domain `augmented_jitterbug` of the dm_control suite: robots of randomized morphology."""

from collections.abc import Callable
from typing import Unpack

from dm_control.rl import control
from dm_control.utils import containers

from jbench.tasks import jitterbug
from jbench.tasks.robots import load_model

SUITE = containers.TaggedTasks()


def _factory(task: str, description: str) -> Callable[..., control.Environment]:
    """Returns a function that makes the environment of a task."""

    def make(
        augment: int = 0,
        vary_masses: bool = False,
        **settings: Unpack[jitterbug.TaskSettings],
    ) -> control.Environment:
        robot = load_model(augment, vary_masses=vary_masses)
        return jitterbug.environment(task, robot, **settings)

    make.__name__, make.__doc__ = task, description
    return make


# The plain robot's five tasks with the settings `augment` (a seed, default 0) and `vary_masses`.
# They are not tagged as benchmarking, since results of different seeds are not comparable.
for _task, _plain in jitterbug.SUITE.items():
    SUITE.add()(_factory(_task, _plain.__doc__))
