"""What trains the agents of a batch of runs: the batched engine, or a plug-in agent's loop."""

from collections.abc import Sequence

from jbench.agents.algorithms import algorithm_of, find_agent, find_rule
from jbench.agents.batched.make import Computation, make_engine
from jbench.agents.engine import Engine
from jbench.agents.environments import Augment
from jbench.agents.plugin import is_resumable
from jbench.agents.plugin_engine import PluginEngine
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.names import EPISODE_STEPS
from jbench.settings.base import settings_with
from jbench.settings.run import RunSettings
from jbench.simulation.find import check_specs
from jbench.training.evaluation import seeds_of


def make_trainer(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Engine:
    """Returns what trains an agent for each run.

    Args:
        runs: settings that can be trained together; see `jbench.training.batched_run.run_batch`.
        encoders: of the observations, one for each run.
        device: see `jbench.devices.find_device`.

    Raises:
        RequestError: if the device is unavailable, the algorithm is not installed or can't be
            made, or the task is not installed or has changed.
        WorkError: if the package of the algorithm can't be imported, or its update rule can't be
            trained.
    """
    settings, seeds = runs[0], [seeds_of(run.seed)[0] for run in runs]
    check_specs(settings.task, settings.specs)

    def augment(episode: int) -> int | None:
        return settings.robot_seed(episode // settings.episodes_on_each)

    if settings.engine == "plugin":
        (seed,), (encoder,) = seeds, encoders
        return _plugin_engine(settings, seed, encoder, augment, device)
    return make_engine(
        settings.algo if settings.is_ours else find_rule(settings.algo),
        algorithm_of(settings),
        settings.task,
        seeds,
        computation=Computation(device, settings.precision),
        environments=settings.environments,
        time_limit=settings.time_limit,
        encoder=encoders,
        ofe=settings.ofe,
        augment=augment,
        episode_steps=EPISODE_STEPS,
    )


def _plugin_engine(
    settings: RunSettings, seed: int, encoder: Encoder | None, augment: Augment, device: str
) -> PluginEngine:
    """Returns the loop around an untrained agent of another package."""
    agent = find_agent(settings.algo)
    return PluginEngine(
        settings.algo,
        agent,
        settings_with(agent.Settings, settings.algo, settings.hyperparameters),
        settings.task,
        seed,
        environments=settings.environments,
        time_limit=settings.time_limit,
        encoder=encoder,
        augment=augment,
        device=find_device(device),
        episode_steps=EPISODE_STEPS,
    )


def restart_reason(settings: RunSettings) -> list[str]:
    """Returns a sentence if a run always starts over, because its agent can't be resumed."""
    if settings.engine != "plugin" or is_resumable(find_agent(settings.algo)):
        return []
    return [f"The agent {settings.algo} has no state and restore, so its runs can't be resumed."]
