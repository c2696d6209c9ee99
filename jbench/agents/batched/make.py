"""Builds an engine from settings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch

from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_features import (
    DDPGOnFeatures,
    OnFeatures,
    SACOnFeatures,
    TD3OnFeatures,
)
from jbench.agents.batched.on_policy import OnPolicyEngine
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.rule import Rule
from jbench.agents.batched.rule_check import checked_rule
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3
from jbench.agents.batched.team import Team
from jbench.agents.batched.tensors import Tensors
from jbench.agents.environments import Augment, Environments
from jbench.agents.generators import Generators
from jbench.cores import cores
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS, PRECISIONS, TimeLimit, in_prose
from jbench.settings.algorithms import AlgorithmSettings, OffPolicySettings, PPOSettings
from jbench.settings.records import OFESettings

LEARNERS: dict[str, type[Learner]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}
"""jbench's own update rules by name of the algorithm."""

ON_FEATURES: dict[str, type[OnFeatures]] = {
    "ddpg": DDPGOnFeatures,
    "sac": SACOnFeatures,
    "td3": TD3OnFeatures,
}
"""Update rules on learned features."""


@dataclass(frozen=True)
class Computation:
    """Where and how an engine computes.

    Attributes:
        device: see `jbench.devices.find_device`.
        precision: one of `jbench.names.PRECISIONS`; parameters are float32 in any case.
        threads: simulation threads; None for one on a CPU, where learning dominates and one
            process per core is faster, and for one per core with a GPU.
        stacked: whether to compute all seeds at once or one after another; None for the faster
            way: stacked on a GPU.
        dtype: of all tensors; tests use float64.
    """

    device: str = "auto"
    precision: str = "float32"
    threads: int | None = None
    stacked: bool | None = None
    dtype: torch.dtype = torch.float32

    def tensors(self, seeds: int) -> Tensors:
        """Returns the container of the tensors of this many seeds, still empty.

        On a GPU, sets the precision of its matrix products.

        Raises:
            RequestError: if the device or the precision does not exist.
        """
        device = find_device(self.device)
        if self.precision not in PRECISIONS:
            raise RequestError(
                f"Unknown precision {self.precision!r}; choose {in_prose(PRECISIONS)}."
            )
        if device.type == "cuda":
            products = torch.backends.cuda.matmul
            products.fp32_precision = "tf32" if self.precision == "tf32" else "ieee"
            # Sums are float32, as on a CPU.
            products.allow_bf16_reduced_precision_reduction = False
        elif self.precision == "tf32":
            raise RequestError("Only a GPU has the precision tf32; type float32 or bfloat16.")
        return Tensors(seeds, self.dtype, device, low_precision=self.precision == "bfloat16")


def make_engine(
    algo: str | type[Rule],
    settings: AlgorithmSettings,
    task: str,
    seeds: Sequence[int],
    *,
    computation: Computation,
    environments: int | None = None,
    time_limit: TimeLimit = "bootstrap",
    encoder: Encoder | Sequence[Encoder | None] | None = None,
    ofe: OFESettings | None = None,
    augment: Augment = lambda episode: None,
    episode_steps: int = EPISODE_STEPS,
) -> OffPolicyEngine | OnPolicyEngine:
    """Returns an engine with one untrained agent per seed.

    Args:
        algo: one of `jbench.settings.algorithms.ALGORITHMS`, or an update rule of another package.
        environments: per agent; None for the settings' number (PPO's n_envs, otherwise 1).
        time_limit: "bootstrap" from an episode's last state, or treat it as "terminal".
        encoder: of all seeds, or one for each seed, with the same number of latents.
        ofe: settings of features learned with the agent (not with PPO); None for no features.
        augment: the robot of each episode.
        episode_steps: control steps in an episode; tests use short episodes.

    Raises:
        RequestError: if the device or the precision does not exist, or there are too many
            environments.
        WorkError: if the replay buffers exceed a GPU's memory, or the rule can't be trained.
        UnsupportedPolicyError: if the rule's policy can't be saved.
    """
    tensors = computation.tensors(len(seeds))
    gpu = tensors.device.type == "cuda"
    count = environments or (settings.n_envs if isinstance(settings, PPOSettings) else 1)
    generators = [Generators(seed, count) for seed in seeds]
    robots = Environments(
        task,
        [seed.environments for seed in generators],
        encoder if isinstance(encoder, Sequence) else [encoder] * len(seeds),
        threads=computation.threads or (cores() if gpu else 1),
        augment=augment,
        episode_steps=episode_steps,
    )
    sizes = robots.size, robots.action_size
    learner: Callable[..., Learner]
    if not isinstance(algo, str):
        assert isinstance(settings, OffPolicySettings)
        learner = partial(AutogradLearner, rule=checked_rule(algo, settings, *sizes))
    else:
        learner = LEARNERS[algo] if ofe is None else partial(ON_FEATURES[algo], ofe=ofe)
    stacked = gpu if computation.stacked is None else computation.stacked
    team: Team[Any] = Team(partial(learner, settings, *sizes), generators, tensors, stacked=stacked)
    if isinstance(settings, PPOSettings):
        return OnPolicyEngine(settings, team, robots, time_limit=time_limit)
    assert isinstance(settings, OffPolicySettings)
    try:
        return OffPolicyEngine(settings, team, robots, time_limit=time_limit)
    except torch.OutOfMemoryError:
        raise WorkError(
            f"The GPU's memory is not enough for the replay buffers of {len(seeds)} seeds: type "
            f"fewer --seeds at a time, or less than --set buffer_size={settings.buffer_size}."
        ) from None
