"""Hyperparameters of jbench's algorithms: a class for each, and where their values come from.

`algorithm.py` has what jbench asks the settings of any algorithm, `foreign.py` its answers for one
of another package, and `base.py` the settings that several of jbench's algorithms share. `ddpg.py`,
`td3.py`, `sac.py` and `ppo.py` have one algorithm each with its sources of hyperparameters, and
`by_name.py` finds the classes by name.
"""

from jbench.settings.algorithms.algorithm import Algorithm
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
    display_name,
    own_algorithm_fields,
)
from jbench.settings.algorithms.ddpg import DDPGSettings
from jbench.settings.algorithms.foreign import Foreign, ForeignRule
from jbench.settings.algorithms.ppo import PPOSettings
from jbench.settings.algorithms.sac import SACSettings
from jbench.settings.algorithms.td3 import TD3Settings

__all__ = [
    "ALGORITHMS",
    "SETTINGS",
    "Algorithm",
    "AlgorithmSettings",
    "DDPGSettings",
    "DeterministicSettings",
    "Foreign",
    "ForeignRule",
    "Initialization",
    "OffPolicySettings",
    "PPOSettings",
    "SACSettings",
    "TD3Settings",
    "algorithm_settings",
    "default_base",
    "default_time_limit",
    "display_name",
    "own_algorithm_fields",
]
