"""jbench's own update rules by name of the algorithm."""

from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.on_features import (
    DDPGOnFeatures,
    OnFeatures,
    SACOnFeatures,
    TD3OnFeatures,
)
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3

LEARNERS: dict[str, type[Learner]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}

ON_FEATURES: dict[str, type[OnFeatures]] = {
    "ddpg": DDPGOnFeatures,
    "sac": SACOnFeatures,
    "td3": TD3OnFeatures,
}
"""Update rules on learned features."""
