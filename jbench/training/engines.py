"""Makes the engine of a batch of runs: jbench's own, or a loop of others."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from jbench.agents.algorithms import hyperparameters
from jbench.agents.batched.engine import BatchedEngine
from jbench.agents.batched.make import make_batched_engine
from jbench.agents.ending_environments import environments_class
from jbench.agents.engine import Engine
from jbench.agents.environments import Environments
from jbench.agents.find import find_class
from jbench.agents.plugin_engine import PluginEngine
from jbench.closing import closed_on_error
from jbench.cores import cores
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.names import EngineName
from jbench.policies.saved import TrainedAgent
from jbench.settings.algorithms import SETTINGS
from jbench.settings.engines import ENGINES
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.tasks.find import check_specs
from jbench.tasks.task import Act
from jbench.training.evaluation import derive_seeds


def make_engine(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Engine:
    """Returns the engine that trains an agent for each run of a batch; see `run_batch`.

    Raises a RequestError if the device is unavailable, the algorithm is not installed or can't be
    made, or the task is not installed or has changed; a WorkError if the package of the algorithm
    can't be imported, or its update rule can't be trained.
    """
    settings = runs[0]
    check_specs(settings.task, settings.specs, settings.accepted is not None)
    return _MAKERS[settings.engine](runs, encoders, device)


def _batched(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Engine:
    """Returns jbench's engine, which trains an algorithm of its own, or an update rule."""
    settings = runs[0]
    algorithm: Any = settings.algo if settings.algo in SETTINGS else find_class(settings.algo)
    values: Any = hyperparameters(settings)
    environments = _environments(runs, encoders, device)
    with closed_on_error(environments):
        return make_batched_engine(
            algorithm,
            values,
            environments,
            time_limit=settings.time_limit,
            device=find_device(device),
            ofe=settings.ofe,
            precision=settings.precision,
        )


def _plugin(runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str) -> Engine:
    """Returns the engine of the agent of another package, for one run."""
    (settings,) = runs
    kind = find_class(settings.algo)
    values = hyperparameters(settings)
    environments = _environments(runs, encoders, device)
    with closed_on_error(environments):
        return PluginEngine(
            settings.algo,
            kind,
            values,
            environments,
            time_limit=settings.time_limit,
            device=find_device(device),
        )


def _stable_baselines3(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Engine:
    """Returns the training loop of stable-baselines3, for one run; it is always on the CPU."""
    from jbench.training.sb3_engine import SB3Engine  # takes a second to import

    (settings,) = runs
    (encoder,) = encoders
    return SB3Engine(settings, encoder, derive_seeds(settings.seed).agent)


_MAKERS: dict[EngineName, Callable[..., Engine]] = {
    "batched": _batched,
    "plugin": _plugin,
    "sb3": _stable_baselines3,
}
"""What makes the engine of runs, given their encoders and the device, by engine."""


def _environments(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Environments:
    """Returns the robots of the agents of all runs."""
    settings = runs[0]
    # On a CPU, learning dominates, and one process per core is faster.
    threads = cores() if find_device(device).type == "cuda" else 1
    return environments_class(settings.task)(
        settings.task,
        [derive_seeds(run.seed).agent for run in runs],
        settings.environments,
        encoders,
        threads=threads,
        augment=lambda episode: settings.robot_seed(episode // settings.episodes_on_each),
        episode_steps=settings.episode_steps,
    )


@contextmanager
def acting_as_evaluated(
    settings: RunSettings | ExternalSettings, agent: TrainedAgent, control_steps: int, device: str
) -> Iterator[Act]:
    """Yields the actions of a run's kept policy, with the bits that its last evaluation had.

    Raises a RequestError or a ValueError if the policy is not that of an agent with these settings.
    """
    if not ENGINES[settings.engine].loads_policies:
        yield agent.act
        return

    assert isinstance(settings, RunSettings)
    # The products of the engine round differently from those of the copy.
    with make_engine([settings], [agent.encoder], device) as engine:
        assert isinstance(engine, BatchedEngine)
        engine.load_policy(0, agent.policy, control_steps)
        yield engine.act
