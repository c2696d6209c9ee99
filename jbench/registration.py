"""Registration of the tasks with Gymnasium; the environments are imported when they are made."""

from typing import Any

from gymnasium.envs.registration import register, registry

from jbench.names import EPISODE_STEPS, TASKS
from jbench.task_specs import SUITE_TASKS


def environment_id(task: str, augmented: bool = False) -> str:
    """Returns the Gymnasium id of a task, such as `Jitterbug/FaceDirection-v0`.

    That of another robot's task, such as `jbench/dmc-cheetah-run-v0`, is registered if it is not.
    """
    if task not in TASKS:
        id = f"jbench/{task.replace(':', '-')}-v0"
        _register(id, "jbench.tasks.dm_gym:SuiteEnv", {"task": task})
        return id
    domain = "AugmentedJitterbug" if augmented else "Jitterbug"
    return f"{domain}/{task.title().replace('_', '')}-v0"


def _register(id: str, entry_point: str, kwargs: dict[str, Any], **more: Any) -> None:
    if id not in registry:
        register(id, entry_point, kwargs=kwargs, max_episode_steps=EPISODE_STEPS, **more)


def register_environments() -> None:
    """Registers the Jitterbug's tasks, with plain and augmented robots, and those of the suite."""
    for task in SUITE_TASKS:
        environment_id(task)
    # The return of a solved task is that of the paper's Figure 9.
    more = {"vector_entry_point": "jbench.tasks.vector:JitterbugVectorEnv"}
    for task in TASKS:
        for augmented, robot in ((False, {}), (True, {"augment": 0})):
            id, kwargs = environment_id(task, augmented), {"task": task, **robot}
            _register(id, "jbench.tasks.gym:JitterbugEnv", kwargs, reward_threshold=900, **more)
