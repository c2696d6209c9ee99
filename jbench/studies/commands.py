"""The commands that trained recorded runs, and those that train them again."""

import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from jbench.representation_names import FULL
from jbench.settings.defaults import chosen
from jbench.settings.recorded import Run, read_run
from jbench.settings.run import RunSettings
from jbench.store.provenance import shell_command
from jbench.studies.rebuilt_matrix import SameSettings, groups
from jbench.typed_values import in_ranges


class Commands(NamedTuple):
    """Command lines that train runs: as they were typed, and rebuilt where none was recorded."""

    typed: list[str]
    rebuilt: list[str]


def commands(runs: Iterable[tuple[Mapping[str, Any], object]]) -> Commands:
    """Returns the command lines that trained runs.

    Args:
        runs: recorded settings, and the recorded words of the command, None for none.
    """
    typed: dict[str, None] = {}
    rest: list[Run] = []
    for settings, words in runs:
        if isinstance(words, list) and words:
            typed[shell_command({"command": words})] = None
        else:
            rest.append(read_run(settings))
    rebuilt = [train_command(group) for group in groups(rest)]
    return Commands(list(typed), rebuilt)


def train_command(group: SameSettings) -> str:
    """Returns the command that trains runs, where the results contain their encoder."""
    run = group.run
    words = ["jbench", "train", "--task", run.task, "--algo", run.algo]
    if run.encoder_draws is not None:
        words += ["--encoder", run.representation, "--encoder-seeds", "each"]
    elif run.encoder is not None:
        words += ["--encoder", run.encoder]
    elif run.representation != FULL:
        words += ["--encoder", run.representation]
    words += ["--seeds", in_ranges(group.seeds)]

    what = chosen(run)
    if what.base is not None and not what.is_usual_base:
        words += ["--settings", what.base]
    for name, value in what.options.items():
        title = RunSettings.model_fields[name].title or name
        words += [f"--{title.replace('_', '-')}", str(value)]
    for name, value in what.hyperparameters.items():
        words += ["--set", f"{name}={_set_value(value)}"]
    for name, value in what.features.items():
        words += ["--set", f"ofe.{name}={_set_value(value)}"]

    return shlex.join(words)


def _set_value(value: Any) -> str:
    """Returns a value as `--set` reads it."""
    if isinstance(value, list) and len(value) > 1:
        return ",".join(map(json.dumps, value))
    if not isinstance(value, str):
        return json.dumps(value)
    try:
        json.loads(value)
    except ValueError:
        return value
    return json.dumps(value)
