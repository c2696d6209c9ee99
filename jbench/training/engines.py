"""What trains the agents of a batch of runs: jbench's engine, or the loop of another package."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jbench.agents.algorithms import find_class, hyperparameters
from jbench.agents.batched.make import make_engine
from jbench.agents.engine import Engine
from jbench.agents.environments import Environments
from jbench.agents.plugin_engine import PluginEngine
from jbench.cores import cores
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.names import EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.simulation import Act
from jbench.simulation.find import check_specs
from jbench.training.evaluation import derive_seeds

if TYPE_CHECKING:
    from jbench.training.sb3_engine import SB3Engine

Trainer: TypeAlias = "Engine | SB3Engine"


def make_trainer(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Trainer:
    """Returns what trains an agent for each run, which may share a process; see `run_batch`.

    Raises a RequestError if the device is unavailable, the algorithm is not installed or can't be
    made, or the task is not installed or has changed; a WorkError if the package of the algorithm
    can't be imported, or its update rule can't be trained.
    """
    settings, seeds = runs[0], [derive_seeds(run.seed)[0] for run in runs]
    check_specs(settings.task, settings.specs)
    if settings.engine == "sb3":
        from jbench.training.sb3_engine import SB3Engine  # takes a second to import

        return SB3Engine(settings, encoders[0], seeds[0])
    algorithm: Any = settings.algo if settings.is_ours else find_class(settings.algo)
    values: Any = hyperparameters(settings)
    train_on = find_device(device)
    environments = Environments(
        settings.task,
        seeds,
        settings.environments,
        encoders,
        # On a CPU, learning dominates, and one process per core is faster.
        threads=cores() if train_on.type == "cuda" else 1,
        augment=lambda episode: settings.robot_seed(episode // settings.episodes_on_each),
        episode_steps=EPISODE_STEPS,
    )
    options: dict[str, Any] = {"time_limit": settings.time_limit, "device": train_on}
    if settings.engine == "plugin":
        return PluginEngine(settings.algo, algorithm, values, environments, **options)
    options |= {"ofe": settings.ofe, "precision": settings.precision}
    return make_engine(algorithm, values, environments, **options)


def policy_function(engine: Trainer, seeds: int) -> Act:
    """Returns what acts on observations (..., dim(O)) in the order of the engine's seeds."""

    def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
        actions = engine.act(observations.reshape(seeds, -1, observations.shape[-1]))
        return actions.reshape(*observations.shape[:-1], -1)

    return act
