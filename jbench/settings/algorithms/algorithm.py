"""What jbench asks the settings of any algorithm, its own or another package's."""

from collections.abc import Collection
from typing import ClassVar, Self

from jbench.errors import RequestError
from jbench.names import EngineName, Precision
from jbench.settings.base import Settings


class Algorithm(Settings):
    """Answers about an algorithm; the defaults are for those of which jbench knows only the name.

    Attributes:
        precisions: of the batched engine's matrix products, in which it learns.
        learns_features: whether the batched engine can learn features with it.
        knows_rollouts: whether its learning phases follow from its settings.
        shares_updates: whether more environments share its updates, as those of the batched engine.
        instead_of_environments: what to type instead of a number of environments that only the
            batched engine has.
    """

    precisions: ClassVar[tuple[Precision, ...]] = ("float32", "tf32")
    learns_features: ClassVar[bool] = False
    knows_rollouts: ClassVar[bool] = False
    shares_updates: ClassVar[bool] = False
    instead_of_environments: ClassVar[str] = "leave it out"

    @classmethod
    def engines(cls, name: str) -> tuple[EngineName, ...]:
        """Returns the engines that may train an algorithm with this name, the usual one first."""
        raise NotImplementedError

    @classmethod
    def choose_engine(cls, name: str, wanted: EngineName | None = None) -> EngineName:
        """Returns the engine that trains an algorithm with this name, the usual one by default.

        Raises a RequestError if the wanted engine does not.
        """
        engines = cls.engines(name)
        if wanted is None:
            return engines[0]
        if wanted not in engines:
            having = " or ".join(engines)
            raise RequestError(f"{name} has the engine {having}, not {wanted}; type {having}.")
        return wanted

    @property
    def environments(self) -> int:
        """Number of parallel environments of an agent, if no other one is typed."""
        return 1

    def first_update(self, environments: int = 1) -> int:
        """Returns the control steps, over all environments, before the first update; 0 if unknown.

        An evaluation that is due at this control step is made before the update.
        """
        return 0

    @property
    def is_mirrored(self) -> bool:
        """Whether it learns from mirror images, too."""
        return False

    def rollout(self, environments: int) -> int:
        """Returns the control steps over all environments between learning phases."""
        return 1

    def only_batched(self, chosen: Collection[str]) -> list[str]:
        """Returns those of the chosen settings that only the batched engine has, in order."""
        return []

    def without_effect(self) -> dict[str, str]:
        """Returns the names of settings without effect, each with the setting that it needs."""
        return {}

    def obstacle_to_features(self) -> str:
        """Returns what prevents features from being learned with it, after their name, or ""."""
        return ""

    def check_environments(self, environments: int) -> Self:
        """Returns itself; a RequestError if `environments` can't share its updates."""
        return self

    def check_stable_baselines3(self) -> Self:
        """Returns itself; a RequestError if stable-baselines3 refuses its settings."""
        return self
