"""DDPG, TD3 and SAC as update rules to subclass: override a network or a loss, and train it.

They make the same updates as `--algo ddpg`, `td3` and `sac`, with the same settings and defaults,
but autograd computes the gradients. `docs/your-own-rule.md` has an example, and
`jbench.Rule` documents the attributes that all rules share.
"""

from jbench.rules.ddpg import DDPG
from jbench.rules.networks import JoiningCritic, mlp
from jbench.rules.sac import SAC
from jbench.rules.td3 import TD3

__all__ = ["DDPG", "SAC", "TD3", "JoiningCritic", "mlp"]
