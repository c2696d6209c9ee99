"""Turns a user's request into settings of runs."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from jbench import names
from jbench.agents.algorithms import algorithm_fields, hyperparameters
from jbench.devices import check_precision, find_device
from jbench.encoders import find_draws, find_encoder, load_encoder
from jbench.encoders.wrapper import input_mirror
from jbench.errors import RequestError
from jbench.representation_names import NO_ENCODER, OFE
from jbench.settings.algorithms import Algorithm, default_time_limit
from jbench.settings.base import task_and_representation, validated
from jbench.settings.engines import ENGINES
from jbench.settings.evaluations import evaluation_schedule
from jbench.settings.records import requested_ofe
from jbench.settings.run import RunSettings
from jbench.settings.specs import episode_steps
from jbench.store import Results
from jbench.tasks.find import find_task

_PREFIX = f"{OFE}."


def request_runs(
    results: Results,
    *,
    algo: str,
    task: str,
    encoder: str,
    seeds: Sequence[int],
    base: names.SettingsBase | None,
    overrides: Mapping[str, Any],
    engine: names.EngineName | None = None,
    encoder_seeds: names.EncoderSeeds = "newest",
    accept_changed: bool = False,
    **fields: Any,
) -> list[RunSettings]:
    """Returns the settings of one run per seed.

    Args:
        algo: one of `ALGORITHMS`, an installed agent or rule, or MODULE:CLASS.
        encoder: "none" or "full", "ofeN" for N features learned with the agent, or the name or id
            of an encoder in the results; see `jbench.encoders.find_encoder`.
        base: see `names.SettingsBase`; None for that of the task.
        overrides: hyperparameters by name; ofe.NAME is a setting of ofeN.
        engine: None for the engine that follows from the algorithm.
        accept_changed: whether the encoder may be one whose kind has other code now.
        fields: the other fields of `RunSettings`; `evaluate_every` and `evaluate_episodes` are None
            for the default.

    Raises a RequestError if the encoder is not found or can't be mirrored, there is none that each
    agent could have, a setting is invalid, or the steps are not enough for an episode or can't be
    divided among the robots.
    """
    of_algorithm: dict[str, Any] = {}
    of_features: dict[str, Any] = {}
    for name, value in overrides.items():
        if name.startswith(_PREFIX):
            of_features[name.removeprefix(_PREFIX)] = value
        else:
            of_algorithm[name] = value

    ofe = requested_ofe(encoder, of_features)
    if of_features and ofe is None:
        raise RequestError("--set ofe.NAME is for --encoder ofeN, such as ofe12; leave it out.")

    encoding = _Encoding({})
    if ofe is not None:
        encoding = _Encoding({"representation": ofe.representation})
    elif encoder not in NO_ENCODER:
        encoding = _encoding(results, encoder, task, seeds, encoder_seeds, accept_changed)
    if encoder_seeds == "each" and encoding.ids is None:
        raise RequestError(
            f"--encoder-seeds each is for agents with an encoder, not for --encoder {encoder}: "
            "leave it out."
        )

    fields |= {
        **algorithm_fields(algo, engine, base, of_algorithm, task),
        **encoding.fields,
        "task": task,
        "specs": find_task(task).specs,
        "ofe": ofe,
        "time_limit": fields.get("time_limit") or default_time_limit(base),
    }
    runs = make_runs(seeds, encoding.ids, **fields)
    first = runs[0]
    if first.encoder is not None and first.algorithm.is_mirrored:
        input_mirror(task, load_encoder(results, first.encoder, accept_changed).encoder)
    return runs


class _Encoding(NamedTuple):
    """What the representation of a request adds to its runs.

    Attributes:
        fields: of `RunSettings`.
        ids: of the encoder of each seed, if each has one of its own.
    """

    fields: Mapping[str, Any]
    ids: Mapping[int, str] | None = None


def _encoding(
    results: Results,
    encoder: str,
    task: str,
    seeds: Sequence[int],
    encoder_seeds: names.EncoderSeeds,
    accept_changed: bool,
) -> _Encoding:
    """Returns what an encoder adds to runs; raises as `find_encoder` and `find_draws`."""
    id = find_encoder(results, encoder, task, accept_changed)
    fields: dict[str, Any] = {
        "encoder": id,
        "representation": read_representation(results, id, accept_changed),
    }
    if encoder_seeds != "each":
        return _Encoding(fields)

    draws = find_draws(results, encoder, task, seeds, accept_changed)
    fields["encoder_draws"] = draws.hash
    return _Encoding(fields, draws.ids)


def make_runs(
    seeds: Sequence[int], encoders: Mapping[int, str] | None = None, **fields: Any
) -> list[RunSettings]:
    """Returns the settings of one run per seed, whose encoders may have ids of their own.

    Raises a RequestError if a value is invalid, the steps are not enough for an episode, the
    environments can't share the updates, or stable-baselines3, or a class with its interface,
    refuses the settings.
    """
    fields["evaluate_every"], fields["evaluate_episodes"] = evaluation_schedule(
        fields["steps"],
        episode_steps(fields["specs"]),
        fields.get("evaluate_every"),
        fields.get("evaluate_episodes"),
    )
    runs = []
    for seed in seeds:
        fields["seed"] = seed
        if encoders:
            fields["encoder"] = encoders[seed]
        runs.append(validated(RunSettings, "the run", **fields))

    _check_steps(runs[0])
    _check_agent(runs[0])
    return runs


def _check_steps(run: RunSettings) -> None:
    """Raises a RequestError if a run is too short for an episode in each of its environments."""
    min_steps = run.episode_steps * run.environments
    if run.steps >= min_steps:
        return

    needed = f"{run.episode_steps}"
    if run.environments > 1:
        needed += f" in each of {run.environments} environments"

    verb = "would end"
    if find_task(run.task).ends_early:
        verb = "is sure to end"

    raise RequestError(
        f"No episode of {run.algo} {verb} in {run.steps} control steps: it takes {needed}; type "
        f"{min_steps} or more."
    )


def _check_agent(run: RunSettings) -> None:
    """Raises a RequestError if the environments of a run can't share its updates.

    So it does if stable-baselines3, or a class with its interface, refuses the settings. An agent
    of another package refuses its settings when it is made.
    """
    settings = hyperparameters(run)
    if isinstance(settings, Algorithm):
        settings.check_environments(run.environments)
    if not ENGINES[run.engine].is_stable_baselines3:
        return

    if isinstance(settings, Algorithm):
        settings.check_stable_baselines3()
        return

    from jbench.agents import sb3  # stable-baselines3 takes a second to import

    task = find_task(run.task)
    sizes = task.observation_size, task.action_size
    sb3.check(run.algo, run.hyperparameters, sizes, run.environments)


def read_representation(results: Results, encoder: str, accept_changed: bool = False) -> str:
    """Returns an encoder's representation, such as dae12; raises as `load_encoder`."""
    load_encoder(results, encoder, accept_changed)
    _, representation = task_and_representation(encoder)
    return representation


def training_device(
    engine: names.EngineName | None, wanted: str, precision: names.Precision = "float32"
) -> str:
    """Returns the device to train on, `cpu`, `cuda` or such as `cuda:1`; see `find_device`.

    Raises a RequestError if it is unavailable, or does not support the engine or precision.
    """
    if engine is not None and not ENGINES[engine].is_for_gpu:
        if wanted.startswith("cuda"):
            raise RequestError(
                f"The engine {engine} trains on the CPU: leave --device {wanted} out, or choose "
                "the engine batched."
            )
        find_device(wanted)
        return "cpu"
    device = str(find_device(wanted))
    check_precision(precision, device)
    return device
