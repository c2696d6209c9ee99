"""Builds an engine from settings."""

from collections.abc import Callable
from functools import partial

import torch

from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_features import OnFeatures
from jbench.agents.batched.on_policy import OnPolicyEngine
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.rule import Rule
from jbench.agents.batched.rule_check import checked_rule
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3
from jbench.agents.batched.tensors import Tensors
from jbench.agents.engine import CPU
from jbench.agents.environments import Environments
from jbench.errors import RequestError, WorkError
from jbench.names import TimeLimit
from jbench.settings.algorithms import AlgorithmSettings, OffPolicySettings, PPOSettings
from jbench.settings.records import OFESettings

LEARNERS: dict[str, type[Learner]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}
"""jbench's own update rules by name of the algorithm."""


def make_engine(
    algo: str | type[Rule],
    settings: AlgorithmSettings,
    environments: Environments,
    *,
    time_limit: TimeLimit = "bootstrap",
    ofe: OFESettings | None = None,
    device: torch.device = CPU,
    precision: str = "float32",
    stacked: bool | None = None,
    dtype: torch.dtype = torch.float32,
) -> OffPolicyEngine | OnPolicyEngine:
    """Returns an engine with one untrained agent per seed.

    Args:
        algo: one of `jbench.settings.algorithms.ALGORITHMS`, or an update rule of another package.
        ofe: settings of features learned with the agent (not with PPO); None for no features.
        precision: one of `jbench.names.PRECISIONS`; parameters are float32 in any case.
        stacked: whether to compute all seeds at once; None for the faster way: on a GPU.
        dtype: of all tensors; tests use float64.

    Raises:
        RequestError: if the device does not have the precision, the number of environments is
            wrong, or `settings.mirror` is not for the encoder of a seed.
        WorkError: if the replay buffers exceed a GPU's memory, or the rule can't be trained.
        UnsupportedPolicyError: if the rule's policy can't be saved.
    """
    sizes = environments.size, environments.action_size
    learner: Callable[..., Learner]
    if not isinstance(algo, str):
        assert isinstance(settings, OffPolicySettings)
        learner = partial(AutogradLearner, rule=checked_rule(algo, settings, *sizes))
    else:
        learner = LEARNERS[algo] if ofe is None else on_features(algo, ofe)
    _set_precision(device, precision)
    seeds, low_precision = len(environments.generators), precision == "bfloat16"
    make = partial(learner, settings, *sizes)
    about = make, Tensors(seeds, dtype, device, low_precision=low_precision), environments
    if stacked is None:
        stacked = device.type == "cuda"
    if isinstance(settings, PPOSettings):
        return OnPolicyEngine(settings, *about, time_limit=time_limit, stacked=stacked)
    assert isinstance(settings, OffPolicySettings)
    try:
        return OffPolicyEngine(settings, *about, time_limit=time_limit, stacked=stacked)
    except torch.OutOfMemoryError:
        raise WorkError(
            f"The GPU's memory is not enough for the replay buffers of {seeds} seeds: type fewer "
            f"--seeds at a time, or less than --set buffer_size={settings.buffer_size}."
        ) from None


def on_features(algo: str, ofe: OFESettings) -> Callable[..., OnFeatures]:
    """Returns what makes a learner of an off-policy algorithm on learned features."""
    return partial(type("OnFeatures", (OnFeatures, LEARNERS[algo]), {}), ofe=ofe)


def _set_precision(device: torch.device, precision: str) -> None:
    if device.type == "cuda":
        products = torch.backends.cuda.matmul
        products.fp32_precision = "tf32" if precision == "tf32" else "ieee"
        # Sums are float32, as on a CPU.
        products.allow_bf16_reduced_precision_reduction = False
    elif precision == "tf32":
        raise RequestError("Only a GPU has the precision tf32; type float32 or bfloat16.")
