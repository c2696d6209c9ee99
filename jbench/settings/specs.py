"""What a task's robot, observation and actions are, as a part of settings."""

from pydantic import Field

from jbench import task_specs
from jbench.settings.base import Count, Settings, omissible

CODE_CHECKSUMS = ("compiled", "sources")
"""Fields of `Specs` that are checksums of the code behind a name, and that old records lack."""

MADE_BY_CODE = ("model", "control_timestep")
"""Fields of `Specs` that users' code makes of a robot, and that may change with it."""


class Specs(Settings):
    """What a task's robot, observation and actions are.

    Part of the settings of runs, datasets and evaluations, since the code behind a task's name may
    change. The Jitterbug's tasks have none.
    """

    model: str | None = Field(None, description="SHA-256 of the MuJoCo model's physical parameters")
    parts: list[str] = Field(description="names of the parts of the observation, in order")
    sizes: list[Count] = Field(description="number of values of each part")
    action_minimum: list[float] = Field(description="what the action -1 is for each actuator")
    action_maximum: list[float] = Field(description="what the action 1 is for each actuator")
    control_timestep: float | None = Field(None, description="s")
    compiled: str | None = omissible(
        None, description="SHA-256 of all of the MuJoCo model that can move the robot"
    )
    sources: str | None = omissible(None, description="checksum of the code of the task")
    episode_steps: Count = omissible(1000, description="control steps of an episode")
    unit_rewards: bool = omissible(
        True, description="whether every reward is in [0, 1], so that returns have a largest value"
    )


def episode_steps(specs: Specs | None) -> int:
    """Returns the control steps of an episode; None are the specs of the Jitterbug."""
    return task_specs.EPISODE_STEPS if specs is None else specs.episode_steps
