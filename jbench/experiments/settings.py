"""The settings of a run: one agent, one task, one seed."""

from typing import Any, Literal

from pydantic import BaseModel, Field

from jbench import validation
from jbench.agents.settings import SETTINGS, AlgorithmSettings
from jbench.names import FULL, LARGEST_SEED, TimeLimit
from jbench.store import settings_hash


class RunSettings(BaseModel):
    """What a run is made of; the id is made from it."""

    model_config = validation.SETTINGS

    task: str
    algo: str
    representation: str = Field(default=FULL, description="full, or what the encoder is, as dae12")
    encoder: str | None = Field(default=None, description="id of the encoder")
    seed: int = Field(ge=0, le=LARGEST_SEED)
    steps: int = Field(gt=0, description="control steps over all environments; section 5.1: 5e6")
    engine: Literal["sb3"] = "sb3"
    time_limit: TimeLimit = "bootstrap"
    evaluate_every: int = Field(gt=0, description="control steps between evaluations")
    evaluate_episodes: int = Field(ge=0, description="episodes in an evaluation")
    hyperparameters: dict[str, Any] = Field(description="every setting of the algorithm")

    @property
    def id(self) -> str:
        """The run's id, such as face_direction/ddpg/dae12/s03-1f9a2c4e."""
        name = f"s{self.seed:02d}-{settings_hash(self.model_dump(mode='json'))}"
        return f"{self.task}/{self.algo}/{self.representation}/{name}"

    @property
    def algorithm(self) -> AlgorithmSettings:
        """The settings of the algorithm."""
        return SETTINGS[self.algo](**self.hyperparameters)

    @property
    def environments(self) -> int:
        """How many environments the agent learns in at a time."""
        return int(self.hyperparameters.get("n_envs", 1))
