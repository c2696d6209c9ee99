"""jbench's algorithms by name, and their settings from a source of hyperparameters."""

from collections.abc import Mapping
from typing import Any

from jbench import task_specs
from jbench.errors import RequestError
from jbench.names import EngineName, SettingsBase, TimeLimit
from jbench.settings.algorithms.base import AlgorithmSettings
from jbench.settings.algorithms.ddpg import DDPGSettings
from jbench.settings.algorithms.ppo import PPOSettings
from jbench.settings.algorithms.sac import SACSettings
from jbench.settings.algorithms.td3 import TD3Settings
from jbench.settings.base import settings_with

SETTINGS: dict[str, type[AlgorithmSettings]] = {
    "ddpg": DDPGSettings,
    "ppo": PPOSettings,
    "sac": SACSettings,
    "td3": TD3Settings,
}

ALGORITHMS = tuple(SETTINGS)
"""The four algorithms of the paper (section 5.1 and Figure 9)."""

TIME_LIMITS: dict[SettingsBase, TimeLimit] = {"figure8": "terminal"}
"""Sources of hyperparameters that also say what the time limit is, unless it is typed."""


def display_name(algo: str) -> str:
    """Returns an algorithm's name as the paper writes it, or as its author does.

    The label `TD3` of a recorded or imported algorithm differs from that of jbench's td3.
    """
    if algo in ALGORITHMS:
        return algo.upper()
    if algo in map(str.upper, ALGORITHMS):
        return f"{algo} (label)"
    return algo


def default_time_limit(base: SettingsBase | None) -> TimeLimit:
    """Returns what the time limit of an episode is if no other one is typed."""
    if base is None:
        return "bootstrap"
    return TIME_LIMITS.get(base, "bootstrap")


def default_base(task: str, base: SettingsBase | None = None) -> SettingsBase:
    """Returns the base as typed; of None, the task's: published for the Jitterbug, else suite."""
    return base or task_specs.default_base(task)


def algorithm_settings(
    algo: str, base: SettingsBase = "published", overrides: Mapping[str, Any] | None = None
) -> AlgorithmSettings:
    """Returns the settings of one of `ALGORITHMS`, with some values by name instead.

    Raises a RequestError if a setting is unknown, its value is invalid, or the base has no such
    algorithm.
    """
    kind = SETTINGS[algo]
    if base not in kind.bases:
        having = ", ".join(name for name, other in SETTINGS.items() if base in other.bases)
        why = f"The settings {base} are for {having}, not for {algo}; choose published"
        if base == "script":
            why = (
                f"The settings of the script are for {having}: the script's {algo} is another "
                "algorithm, with a state-value network; choose published"
            )
        elif base == "figure8":
            why += ", and --set normalize=running for standardized inputs"

        raise RequestError(f"{why}.")

    return settings_with(kind, algo, {**kind.bases[base], **(overrides or {})})


def own_algorithm_fields(
    algo: str,
    engine: EngineName | None,
    base: SettingsBase,
    overrides: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Returns the fields of `RunSettings` that describe one of `ALGORITHMS`.

    Raises a RequestError if it does not have the engine, and as `algorithm_settings`.
    """
    return {
        "algo": algo,
        "engine": SETTINGS[algo].choose_engine(algo, engine),
        "hyperparameters": algorithm_settings(algo, base, overrides).model_dump(mode="json"),
    }
