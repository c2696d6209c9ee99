"""What repeats runs: the matrix that trains them, and the versions of the packages."""

import importlib.metadata
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from packaging.requirements import Requirement

from jbench.settings.recorded import SEED, Run, alike, read_run
from jbench.settings.run import TYPED, RunSettings
from jbench.store import Record

_EVALUATION = "evaluate_"


def matrix(runs: Iterable[Record], encoders: Mapping[str, Record]) -> str:
    """Returns a matrix file for `jbench sweep` with a part for each configuration.

    Runs whose settings jbench can't train, such as those of recorded loops, are named in comments.
    """
    groups: dict[str, list[RunSettings]] = {}
    others: dict[str, int] = {}
    for record in runs:
        run: Run = read_run(record.settings)
        if isinstance(run, RunSettings):
            groups.setdefault(alike(run, SEED), []).append(run)
        else:
            name = f"{run.task} {run.algo} {run.representation}"
            others[name] = others.get(name, 0) + 1

    text = "# What trains these runs: jbench sweep matrix.toml\n"
    for name, count in others.items():
        text += f"# {count} runs of {name} were trained by another program.\n"

    for group in groups.values():
        text += _part(group, encoders)

    return text


def _part(group: Sequence[RunSettings], encoders: Mapping[str, Record]) -> str:
    """Returns the part of a matrix file that trains a group of runs again."""
    run = group[0]
    keys: dict[str, Any] = {
        "tasks": [run.task],
        "algos": [run.algo],
        "representations": [run.representation],
        "seeds": sorted(each.seed for each in group),
    }
    defaults = RunSettings.model_fields
    for name in TYPED:
        value = getattr(run, name)
        if not name.startswith(_EVALUATION) and value != defaults[name].default:
            keys[defaults[name].title or name] = value

    keys["steps"] = run.steps
    keys["time_limit"] = run.time_limit
    keys["evaluation"] = {"every": run.evaluate_every, "episodes": run.evaluate_episodes}
    keys["hyperparameters"] = {run.algo: dict(run.hyperparameters)}
    if run.ofe is not None:
        keys["ofe"] = run.ofe.model_dump(mode="json")

    if run.encoder is not None and run.encoder in encoders:
        if run.encoder_draws:
            settings = encoders[run.encoder].settings
            keys["encoder"] = {
                "seed": "each",
                "options": {settings["kind"]: settings["options"]},
            }
        else:
            # By its name, it would be trained again, perhaps on another dataset.
            keys["representations"] = [run.encoder]

    lines = [f"{name} = {_toml(value)}" for name, value in keys.items()]
    return "\n".join(["", "[[part]]", *lines, ""])


def _toml(value: Any) -> str:
    """Returns a JSON value as TOML, which has no null: those of a table are left out."""
    if isinstance(value, Mapping):
        pairs = (
            f"{json.dumps(str(name))} = {_toml(item)}"
            for name, item in value.items()
            if item is not None
        )
        return f"{{ {', '.join(pairs)} }}"

    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"

    return json.dumps(value)


def lock() -> str:
    """Returns the installed versions of jbench and of all that it needs, for pip."""
    versions: dict[str, str] = {}
    waiting = ["jbench"]
    while waiting:
        name = waiting.pop()
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue

        if name in versions:
            continue
        versions[name] = distribution.version
        for text in distribution.requires or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name.lower().replace("_", "-"))

    lines = [f"{name}=={version}" for name, version in sorted(versions.items())]
    return "# The versions with which this archive was written.\n" + "\n".join(lines) + "\n"
