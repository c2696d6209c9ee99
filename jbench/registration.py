"""Registration of the tasks with Gymnasium; the environments are imported when they are made."""

from gymnasium.envs.registration import register, registry

from jbench.names import EPISODE_STEPS, TASKS

_SOLVED = 900  # return (paper, Figure 9)


def environment_id(task: str, augmented: bool = False) -> str:
    """Returns the Gymnasium id of a task, such as `Jitterbug/FaceDirection-v0`."""
    domain = "AugmentedJitterbug" if augmented else "Jitterbug"
    return f"{domain}/{task.title().replace('_', '')}-v0"


def register_environments() -> None:
    """Registers the five tasks with Gymnasium, with plain and augmented robots."""
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
