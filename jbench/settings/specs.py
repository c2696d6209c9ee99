"""The specification of a task that is not one of the Jitterbug's."""

from pydantic import Field

from jbench.settings.base import Count, Settings


class Specs(Settings):
    """What a task's robot, observation and actions are.

    Part of the settings of runs, datasets and evaluations, since the code behind a task's name may
    change. The Jitterbug's tasks have none.
    """

    model: str | None = Field(
        default=None, description="SHA-256 of the physical parameters of the MuJoCo model"
    )
    parts: list[str] = Field(description="names of the parts of the observation, in order")
    sizes: list[Count] = Field(description="number of values of each part")
    action_minimum: list[float] = Field(description="what the action -1 is for each actuator")
    action_maximum: list[float] = Field(description="what the action 1 is for each actuator")
    control_timestep: float | None = Field(default=None, description="s")
