"""Making an engine from what a user asks for."""

from collections.abc import Callable, Sequence
from functools import partial

import torch

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.environments import Environments, Models
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_policy import OnPolicyEngine
from jbench.agents.batched.rules import LEARNERS, ON_FEATURES
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.team import Team
from jbench.agents.batched.tensors import Tensors
from jbench.encoders import Encoder
from jbench.errors import RequestError
from jbench.names import DEVICES, EPISODE_STEPS, PRECISIONS, TimeLimit, one_of
from jbench.settings.algorithms import AlgorithmSettings, OffPolicySettings, PPOSettings
from jbench.settings.ofe import OFESettings
from jbench.store.provenance import cores


def make_engine(
    algo: str,
    settings: AlgorithmSettings,
    task: str,
    seeds: Sequence[int],
    *,
    environments: int | None = None,
    time_limit: TimeLimit = "bootstrap",
    encoder: Encoder | None = None,
    ofe: OFESettings | None = None,
    models: Models | None = None,
    device: str = "auto",
    precision: str = "float32",
    threads: int | None = None,
    stacked: bool | None = None,
    dtype: torch.dtype = torch.float32,
    episode_steps: int = EPISODE_STEPS,
) -> Engine:
    """Returns agents of several seeds that have learned nothing yet.

    Args:
        algo: one of `jbench.names.ALGORITHMS`.
        settings: of that algorithm.
        task: one of `jbench.names.TASKS`.
        seeds: one for each agent.
        environments: of each agent; those of the settings for None: 1, and PPO's n_envs.
        time_limit: whether the value of an episode's last state counts.
        encoder: of the observations.
        ofe: settings of features that are learned with the agent; not with PPO. None for none.
        models: the robot of every episode; the plain one for None.
        device: "cpu", "cuda", or "auto" for the second where there is one.
        precision: one of `jbench.names.PRECISIONS`; what is learned is float32 in any case.
        threads: how many robots are stepped at a time; None for one on a CPU, where the learning
            takes the time and a process for each core is faster, and for all cores beside a GPU.
        stacked: whether all seeds are computed at a time, or one after another; None for the
            faster: the first on a GPU.
        dtype: of all numbers; other than float32 for tests.
        episode_steps: in an episode; other than the tasks' own for tests.

    Raises:
        RequestError: if there is no such device or precision, or the environments are too many.
    """
    place = device_of(device)
    if precision not in PRECISIONS:
        raise RequestError(f"Unknown precision {precision!r}; choose {one_of(PRECISIONS)}.")
    gpu = place.type == "cuda"
    if precision == "tf32" and not gpu:
        raise RequestError("Only a GPU has the precision tf32; type float32 or bfloat16.")
    if gpu:
        torch.backends.cuda.matmul.fp32_precision = "tf32" if precision == "tf32" else "ieee"
    count = environments or (settings.n_envs if isinstance(settings, PPOSettings) else 1)
    streams = [Streams(seed, count) for seed in seeds]
    worlds = Environments(
        task,
        [stream.environments for stream in streams],
        encoder=encoder,
        threads=threads or (cores() if gpu else 1),
        models=models,
        episode_steps=episode_steps,
    )
    rule: Callable[..., Learner] = LEARNERS[algo]
    if ofe is not None:
        rule = partial(ON_FEATURES[algo], ofe=ofe)
    team: Team[Learner] = Team(
        rule,
        settings,
        worlds.size,
        Tensors(len(seeds), dtype, place),
        stacked=gpu if stacked is None else stacked,
        low_precision=precision == "bfloat16",
    )
    if isinstance(settings, PPOSettings):
        return OnPolicyEngine(settings, team, worlds, streams, time_limit=time_limit)
    assert isinstance(settings, OffPolicySettings)
    return OffPolicyEngine(settings, team, worlds, streams, time_limit=time_limit)


def device_of(name: str) -> torch.device:
    """Returns the device of a name in `jbench.names.DEVICES`.

    Raises:
        RequestError: if there is no such device.
    """
    if name not in DEVICES:
        raise RequestError(f"Unknown device {name!r}; choose {one_of(DEVICES)}.")
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        raise RequestError("There is no CUDA device here; type --device cpu.")
    return torch.device("cuda" if there and name != "cpu" else "cpu")
