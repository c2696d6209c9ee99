"""Registration of the tasks with Gymnasium; the environments are imported when they are made."""

from gymnasium.envs.registration import register, registry

from jbench.names import EPISODE_STEPS, TASKS
from jbench.task_specs import SUITE_TASKS

_SOLVED = 900  # return (paper, Figure 9)


def environment_id(task: str, augmented: bool = False) -> str:
    """Returns the Gymnasium id of a task, such as `Jitterbug/FaceDirection-v0`.

    That of another robot's task, such as `jbench/dmc-cheetah-run-v0`, is registered if it is not.
    """
    if task not in TASKS:
        return _registered(task)
    domain = "AugmentedJitterbug" if augmented else "Jitterbug"
    return f"{domain}/{task.title().replace('_', '')}-v0"


def _registered(task: str) -> str:
    id = f"jbench/{task.replace(':', '-')}-v0"
    if id not in registry:
        register(
            id,
            entry_point="jbench.simulation.suite_env:SuiteEnv",
            kwargs={"task": task},
            max_episode_steps=EPISODE_STEPS,
        )
    return id


def register_environments() -> None:
    """Registers the Jitterbug's tasks, with plain and augmented robots, and those of the suite."""
    for task in SUITE_TASKS:
        _registered(task)
    for task in TASKS:
        for augmented, robot in ((False, {}), (True, {"augment": 0})):
            if environment_id(task, augmented) not in registry:
                register(
                    environment_id(task, augmented),
                    entry_point="jbench.tasks.gym:JitterbugEnv",
                    vector_entry_point="jbench.simulation.vector_env:JitterbugVectorEnv",
                    kwargs={"task": task, **robot},
                    max_episode_steps=EPISODE_STEPS,
                    reward_threshold=_SOLVED,
                )
