"""The update rules by the name of their algorithm."""

from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3

LEARNERS: dict[str, type[Learner]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}
