"""From what a user asks for to the settings of the runs."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from jbench.encoders import find_encoder, load_encoder
from jbench.errors import RequestError
from jbench.names import EPISODE_STEPS, OFE, Base, Engine, Precision, known
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.base import validated
from jbench.settings.ofe import OFESettings
from jbench.settings.run import RunSettings
from jbench.store import Results

_PREFIX = f"{OFE}."


def request_runs(
    results: Results,
    *,
    algo: str,
    task: str,
    encoder: str,
    seeds: Sequence[int],
    base: Base,
    overrides: Mapping[str, Any],
    **fields: Any,
) -> list[RunSettings]:
    """Returns the settings of one run for each seed.

    Args:
        results: where the encoder is.
        algo: one of `jbench.names.ALGORITHMS`.
        task: one of `jbench.names.TASKS`.
        encoder: "none", "ofeN" for N features that are learned with the agent, a number of
            latents, or an encoder's id.
        seeds: one for each run.
        base: "published", "script" or "sb3"; see `algorithm_settings`.
        overrides: values of single settings by name; ofe.NAME names those of ofeN.
        fields: the other fields of `RunSettings`.

    Raises:
        RequestError: if there is no such encoder, setting or robot, no episode could end, or the
            robots don't divide the steps into whole episodes.
    """
    of_features = {
        name.removeprefix(_PREFIX): value
        for name, value in overrides.items()
        if name.startswith(_PREFIX)
    }
    of_algorithm = {n: value for n, value in overrides.items() if not n.startswith(_PREFIX)}
    fields["ofe"] = ofe = requested_ofe(encoder, of_features)
    if ofe is not None:
        fields["representation"] = ofe.representation
    elif of_features:
        raise RequestError(
            "--set ofe.NAME=VALUE is for --encoder ofeN, such as ofe12; leave it out."
        )
    elif encoder != "none":
        fields["encoder"] = found = find_encoder(results, encoder, task)
        fields["representation"] = representation_of(results, found)
    algorithm = algorithm_settings(algo, base, of_algorithm)
    return runs_of(
        seeds,
        task=task,
        algo=algo,
        hyperparameters=algorithm.model_dump(mode="json"),
        **fields,
    )


def runs_of(seeds: Sequence[int], **fields: Any) -> list[RunSettings]:
    """Returns the settings of one run for each seed.

    Args:
        seeds: one for each run.
        fields: the other fields of `RunSettings`.

    Raises:
        RequestError: if a value is invalid, or no episode could end.
    """
    runs = [validated(RunSettings, "the run", seed=seed, **fields) for seed in seeds]
    least, steps = EPISODE_STEPS * runs[0].environments, runs[0].steps
    if steps < least:
        raise RequestError(
            f"No episode would end in {steps} control steps, since {runs[0].environments} "
            f"environments of {EPISODE_STEPS} control steps run in parallel: steps must be {least} "
            "or more."
        )
    return runs


def representation_of(results: Results, encoder: str) -> str:
    """Returns what an agent with an encoder sees, such as dae12.

    Raises:
        RequestError: if there is no such encoder.
    """
    _, description = load_encoder(results, encoder)
    return f"{description['kind']}{description['latents']}"


def requested_ofe(name: str, options: Mapping[str, Any]) -> OFESettings | None:
    """Returns the settings of a representation such as ofe12, or None if it is another one.

    Args:
        name: of a representation, as a user types it.
        options: settings that are not at their defaults.

    Raises:
        RequestError: if the number is missing, or a setting is unknown, or its value is invalid.
    """
    found = re.fullmatch(rf"{OFE}:?([0-9]*)", name)
    if found is None:
        return None
    if not found[1]:
        raise RequestError(f"{name} needs a number of features: type {OFE}12 or {OFE}240.")
    check_options(options)
    return validated(OFESettings, name, units=int(found[1]), **options)


def check_options(options: Mapping[str, Any]) -> None:
    """Raises a RequestError that names the settings of ofe if one of the options is none."""
    for option in options:
        known(f"setting of {OFE}", option, [n for n in OFESettings.model_fields if n != "units"])


def find_device(engine: Engine, wanted: str, precision: Precision = "float32") -> str:
    """Returns the device to learn on, `cpu` or `cuda`.

    Args:
        engine: that trains.
        wanted: one of `jbench.names.DEVICES`.
        precision: of its products.

    Raises:
        RequestError: if it is not there, or not for this engine or precision.
    """
    if engine == "sb3":
        if wanted == "cuda":
            raise RequestError("--device cuda is for --engine batched; stable-baselines3 gets cpu.")
        return "cpu"
    from jbench.agents.batched.make import device_of

    found = device_of(wanted).type
    if precision == "tf32" and found == "cpu":
        raise RequestError("Only a GPU has --precision tf32; type float32 or bfloat16.")
    return found
