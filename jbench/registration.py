"""Registration of the tasks with Gymnasium; the environments are imported when they are made."""

import re
import zlib
from typing import Any

from jbench.names import TASKS
from jbench.task_specs import EPISODE_STEPS, SOLVED_RETURN, SUITE_TASKS, has_specs


def environment_id(task: str, augmented: bool = False) -> str:
    """Returns the Gymnasium id of a task, such as `Jitterbug/FaceDirection-v0`.

    That of another robot's task is such as `jbench/dmc-cheetah-run-v0`; see `register_task`.
    """
    if has_specs(task):
        return f"jbench/{_gymnasium_name(task)}-v0"
    domain = "AugmentedJitterbug" if augmented else "Jitterbug"
    return f"{domain}/{task.title().replace('_', '')}-v0"


def _gymnasium_name(task: str) -> str:
    """Returns a name of which Gymnasium's ids may consist, another one for each task."""
    name = re.sub(r"[^\w.-]", "-", task)
    if name == task.replace(":", "-"):
        return name
    return f"{name}-{zlib.crc32(task.encode()):08x}"


def _register(id: str, kwargs: dict[str, Any], reward_threshold: float | None = None) -> None:
    """Registers an environment, unless its id is taken."""
    # Imported here, since jbench registers as soon as Gymnasium is imported.
    from gymnasium.envs.registration import register, registry

    if id not in registry:
        register(
            id,
            "jbench.tasks.gym:RobotEnv",
            vector_entry_point="jbench.tasks.vector:RobotVectorEnv",
            kwargs=kwargs,
            max_episode_steps=EPISODE_STEPS,
            reward_threshold=reward_threshold,
        )


def register_task(task: str) -> None:
    """Registers a task with Gymnasium, of the Jitterbug with plain and augmented robots.

    The registry's time limit is that of the Jitterbug and the suite: `gymnasium.make` takes that of
    a task with episodes of another length as `max_episode_steps`.
    """
    if has_specs(task):
        _register(environment_id(task), {"task": task})
        return

    _register(environment_id(task), {"task": task}, SOLVED_RETURN)
    augmented = {"task": task, "augment": 0}
    _register(environment_id(task, augmented=True), augmented, SOLVED_RETURN)


def register_environments() -> None:
    """Registers the tasks of the Jitterbug and of the suite."""
    for task in (*SUITE_TASKS, *TASKS):
        register_task(task)
