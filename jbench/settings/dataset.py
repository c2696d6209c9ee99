"""The settings of a random-policy dataset."""

from pydantic import Field, field_validator

from jbench.names import EPISODE_STEPS
from jbench.settings.base import Seed, Settings, in_id, omissible
from jbench.settings.specs import Specs

JITTERBUG = "jitterbug"
"""Robot of a dataset that serves all five tasks."""


class DatasetSettings(Settings):
    """Settings that identify a dataset."""

    policy: str = "random"
    robot: str = Field(default=JITTERBUG, description="or the name of a task of another robot")
    specs: Specs | None = omissible(None, description="of a task of another robot")
    seed: Seed = 0
    steps: int = Field(
        default=5_000_000, gt=0, description="control steps (paper, section 5.2: 5 million)"
    )
    augment: Seed | None = omissible(None, description="seed of an augmented robot")

    @field_validator("steps")
    @classmethod
    def _whole_episodes(cls, steps: int) -> int:
        if steps % EPISODE_STEPS:
            up = (steps // EPISODE_STEPS + 1) * EPISODE_STEPS
            raise ValueError(
                f"episodes last {EPISODE_STEPS} control steps; steps must be a multiple, such as "
                f"{up}"
            )
        return steps

    @property
    def id(self) -> str:
        """The dataset's id, such as random/s00-1f9a2c4e or dmc.cheetah-run/random/s00-59ba1e20."""
        robot = "" if self.specs is None else f"{in_id(self.robot)}/"
        return f"{robot}{self.policy}/s{self.seed:02d}-{self.hash}"
