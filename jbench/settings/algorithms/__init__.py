"""Hyperparameters of jbench's algorithms: a class for each, and where their values come from.

base.py        settings that several algorithms share
ddpg.py, td3.py, sac.py, ppo.py    one algorithm each, with its sources of hyperparameters
by_name.py     the classes by name, and settings from a source and changes
"""

from jbench.settings.algorithms.base import (
    AlgorithmSettings,
    DeterministicSettings,
    Initialization,
    OffPolicySettings,
)
from jbench.settings.algorithms.by_name import (
    ALGORITHMS,
    SETTINGS,
    algorithm_settings,
    default_base,
    default_time_limit,
)
from jbench.settings.algorithms.ddpg import DDPGSettings
from jbench.settings.algorithms.ppo import PPOSettings
from jbench.settings.algorithms.sac import SACSettings
from jbench.settings.algorithms.td3 import TD3Settings

__all__ = [
    "ALGORITHMS",
    "SETTINGS",
    "AlgorithmSettings",
    "DDPGSettings",
    "DeterministicSettings",
    "Initialization",
    "OffPolicySettings",
    "PPOSettings",
    "SACSettings",
    "TD3Settings",
    "algorithm_settings",
    "default_base",
    "default_time_limit",
]
