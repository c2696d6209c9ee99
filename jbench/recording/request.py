"""`jbench.record`: from its arguments to the settings of a run that is recorded."""

import importlib.metadata
import math
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jbench import names, plugins, sources
from jbench.encoders import encoder_code, find_encoder
from jbench.errors import RequestError
from jbench.loggers.logger import make_logger
from jbench.names import LoggerName, TimeLimit
from jbench.recording.recorder import Recording
from jbench.representation_names import NO_ENCODER, OFE, kind_in
from jbench.settings.base import validated
from jbench.settings.evaluations import EVALUATION_EPISODES, evaluation_interval
from jbench.settings.recorded import COMPARED
from jbench.settings.records import ExternalSettings
from jbench.settings.specs import episode_steps
from jbench.store import Results, files
from jbench.store.planned import planned, say_changed
from jbench.store.shipped import results_to_write
from jbench.store.weights import encoder_weights
from jbench.tasks.find import checked_task, episode_provenance, task_provenance
from jbench.training.request import read_representation
from jbench.typed_values import known

_MAIN_PART = re.compile(rb"^if __name__ == ", re.MULTILINE)
_STEPS = ("steps", "total_timesteps", "total_steps", "timesteps", "n_timesteps")


def record(
    task: str,
    *,
    algo: str,
    seed: int,
    steps: int,
    hyperparameters: Mapping[str, Any] | None = None,
    results: Path | str = "results",
    encoder: str | int = "none",
    time_limit: TimeLimit = "bootstrap",
    augment: int | None = None,
    evaluate_every: int | None = None,
    evaluate_episodes: int = EVALUATION_EPISODES,
    package: str | None = None,
    log: LoggerName | None = None,
) -> Recording:
    """Records a training loop as a run of a results directory.

    Args:
        task: see `jbench.tasks.find_task`; of a function of yours, MODULE:NAME, in another file
            than the script that records.
        algo: label of the algorithm, such as cleanrl-td3.
        seed: of the run; its environments and evaluations are seeded by it.
        steps: control steps over all environments that the loop will make.
        hyperparameters: JSON values by name; part of the run's id. Runs that differ in them are
            drawn as separate curves. "seed" and "total_timesteps" are left out of them.
        results: results directory.
        encoder: as `jbench train --encoder`: "none" or "full", a number of latents, KIND:LATENTS
            or an id.
        time_limit: "bootstrap" truncates an episode at its time limit, "terminal" terminates it.
        augment: seed of the augmented robot, or None for the plain robot.
        evaluate_every: control steps between evaluations; None for a tenth of the run, at most
            50,000.
        evaluate_episodes: episodes in an evaluation.
        package: distribution of the agent, whose version is recorded in the provenance.
        log: experiment tracker that gets the rows, too, as `jbench train --log`.

    Raises:
        RequestError: if a value is invalid, there is no such encoder, the tracker is not
            installed, or the results are the shipped ones.
    """
    _check_task(task)
    place = results_to_write(Path(results))
    typed = {
        "task": task,
        "algo": algo,
        "seed": seed,
        "steps": steps,
        "time_limit": time_limit,
        "augment": augment,
        "evaluate_every": evaluate_every,
        "evaluate_episodes": evaluate_episodes,
    }
    fields = {name: _number(value) for name, value in typed.items()}
    settings = _settings(fields, hyperparameters, str(encoder), place)
    logger = None
    if log is not None:
        logger = make_logger(known("log", log, names.LOGGERS), place.path)

    code = {**task_provenance(task), **encoder_code(place, settings.encoder)}
    records, _ = place.scan("run", _folder(settings))
    plan = planned(settings, records, code, COMPARED)
    for sentence in say_changed([plan], {record.id for record in records}):
        print(sentence, file=sys.stderr, flush=True)

    weights = encoder_weights(place, settings.encoder)
    made_on = {"script_sha256": _script_hash(), **episode_provenance(task), **code, **weights}
    if package is not None:
        made_on.update(_package_provenance(package))

    return Recording(plan.settings, place, made_on, logger)


def _check_task(task: object) -> None:
    """Raises a RequestError for an environment, and for a function of the running script.

    A process that imports the script by its name would run the whole loop a second time, unless
    the script has a part that only runs as `__main__`.
    """
    if not isinstance(task, str):
        reason = f"is of type {type(task).__name__}, not the name of one"
    elif plugins.is_imported(task) and _would_run_again(task.partition(":")[0]):
        reason = f"can't be {task!r}, a function of the running script"
    else:
        return

    raise RequestError(
        f"The task of a recording {reason}: type MODULE:NAME of a function that returns the "
        "environment, in a file of its own, such as 'arm:make'."
    )


def _would_run_again(module: str) -> bool:
    """Returns whether a module is `__main__`, or the running script without a part for that."""
    if module == "__main__":
        return True

    script = getattr(sys.modules.get("__main__"), "__file__", None)
    if script is None or not plugins.is_module(module):
        return False

    file = sources.module_file(module)
    if file is None or not (file.is_file() and Path(script).is_file()):
        return False

    return file.samefile(script) and _MAIN_PART.search(file.read_bytes()) is None


def _settings(
    fields: dict[str, Any],
    hyperparameters: Mapping[str, Any] | None,
    representation: str,
    results: Results,
) -> ExternalSettings:
    """Returns the settings of a run from its typed fields; a RequestError if one is invalid."""
    # A task or label that does not exist is reported before an encoder that does not.
    is_default = fields["evaluate_every"] is None
    checked = dict(fields)
    if is_default:
        checked["evaluate_every"] = 1

    first = validated(ExternalSettings, "the run", hyperparameters={}, **checked)

    about = checked_task(first.task)
    specs = about.specs
    length = episode_steps(specs)
    if first.steps < length and not about.ends_early:
        raise RequestError(
            f"No episode would end in {first.steps} control steps: steps must be {length} or more."
        )
    if is_default:
        # So that a run that is shorter than its longest episode is evaluated at its end.
        fields["evaluate_every"] = min(evaluation_interval(first.steps, length), first.steps)

    if representation not in NO_ENCODER:
        if kind_in(representation).rstrip(":") == OFE:
            raise RequestError(
                f"encoder={representation!r} is learned together with jbench's own agents; choose "
                "none or an encoder of these results."
            )

        fields["encoder"] = find_encoder(results, representation, first.task)
        fields["representation"] = read_representation(results, fields["encoder"])

    if hyperparameters is None:
        hyperparameters = {}

    plain = _plain_hyperparameters(hyperparameters, first.seed, first.steps)
    return validated(ExternalSettings, "the run", specs=specs, hyperparameters=plain, **fields)


def _script_hash() -> str | None:
    """Returns the SHA-256 of the program; None in a notebook or an interactive session."""
    try:
        return files.sha256(Path(sys.modules["__main__"].__file__ or "").read_bytes())
    except (AttributeError, KeyError, OSError):
        return None


def _package_provenance(package: str) -> dict[str, str | None]:
    """Returns the version of a distribution; a RequestError if it is not installed."""
    try:
        return plugins.made_with(package)
    except (importlib.metadata.PackageNotFoundError, ValueError):  # ValueError of an empty name
        raise RequestError(f"package={package!r} is not an installed distribution.") from None


def _folder(settings: ExternalSettings) -> str:
    """Returns the part of a run's id that its seeds have in common."""
    return f"{settings.id.rpartition('/')[0]}/"


def _plain_hyperparameters(values: Mapping[str, Any], seed: int, steps: int) -> dict[str, Any]:
    """Returns JSON values without those that are settings of the run already, and must agree."""
    if not isinstance(values, Mapping) or not all(isinstance(name, str) for name in values):
        raise RequestError(f"hyperparameters is {values!r}: type a dictionary of values by name.")

    plain = {name: _plain(value, f"hyperparameters[{name!r}]") for name, value in values.items()}
    given = {"seed": ("seed", seed), **dict.fromkeys(_STEPS, ("steps", steps))}
    for name, (field, number) in given.items():
        if plain.pop(name, number) != number:
            raise RequestError(
                f"hyperparameters[{name!r}] is {values[name]!r}, but {field}={number}: type the "
                "same number in both, or leave it out of the hyperparameters."
            )

    return plain


def _plain(value: Any, where: str) -> Any:
    """Returns a setting as JSON has it; a RequestError says which part can't be recorded."""
    value = _number(value)
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        return {name: _plain(item, f"{where}[{name!r}]") for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, int | str | None) or (isinstance(value, float) and math.isfinite(value)):
        return value

    raise RequestError(
        f"{where} is {value!r}, which can't be recorded: type finite numbers, texts, None, lists "
        "and dictionaries."
    )


def _number(value: Any) -> Any:
    """Returns a NumPy number as one of Python."""
    if isinstance(value, np.generic):
        return value.item()
    return value
