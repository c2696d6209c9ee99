"""The settings of an evaluation of a policy."""

from pydantic import Field

from jbench.settings.base import Count, Seed, Settings, in_id, omissible
from jbench.settings.specs import Specs


class EvaluationSettings(Settings):
    """Settings that identify an evaluation."""

    task: str
    specs: Specs | None = omissible(None, description="of a task of another robot")
    policy: str = Field(description="as typed by the user, such as heuristic; a file has no path")
    episodes: Count = 100
    seed: Seed = 0
    states: bool = Field(default=False, description="whether to record every state")
    target_yaw: float | None = Field(default=None, description="rad; None: drawn by the task")
    augment: Seed | None = Field(default=None, description="seed of an augmented robot")
    code: str | None = omissible(
        None, description="package and version of an imported policy, or its file's SHA-256"
    )

    @property
    def id(self) -> str:
        """The evaluation's id, such as move_to_pose/heuristic/s00-1f9a2c4e."""
        name = in_id(self.policy).replace("/", ".")
        return f"{in_id(self.task)}/{name}/s{self.seed:02d}-{self.hash}"
