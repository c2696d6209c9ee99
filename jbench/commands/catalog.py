"""Commands that list algorithms, tasks and datasets."""

import importlib.util
from collections.abc import Callable, Iterable, Iterator
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument

from jbench import names, task_specs
from jbench.commands import options, output, parsing
from jbench.errors import RequestError, WorkError
from jbench.settings.algorithms import ALGORITHMS, SETTINGS
from jbench.wording import counted, progress_text, with_results

if TYPE_CHECKING:
    pass

_Entry = dict[str, Any]


def algorithms(
    name: str | None = Argument(None, help="Only this one, or MODULE:CLASS, and its settings."),
    json: bool = options.JSON,
) -> None:
    """List the installed algorithms with their settings."""
    from jbench.agents.find import installed

    if name is not None:
        _show_algorithm(_algorithm_entry(name))
        return

    columns = {
        "--algo": "name",
        "meaning": "description",
        "engine": "engine",
        "package": "package",
        "settings": "settings",
    }
    hint = "jbench algorithms NAME explains the settings of one; --set changes them."
    _list("algorithm", (*ALGORITHMS, *installed()), _algorithm_entry, columns, hint)


def _algorithm_entry(algorithm: str) -> _Entry:
    """Returns an algorithm as the document describes it."""
    from jbench.agents import algorithms as known

    return {
        "name": algorithm,
        "description": known.description(algorithm),
        "engine": known.choose_engine(algorithm),
        "package": _package(algorithm),
        "settings": known.describe_settings(algorithm),
    }


def _package(algorithm: str) -> str | None:
    """Returns name and version of the package of an algorithm; None if it is in no package."""
    from jbench import plugins
    from jbench.agents.find import algorithm_provenance

    if algorithm in ALGORITHMS:
        return plugins.made_with("jbench").get("package")
    return algorithm_provenance(algorithm).get("package")


def _show_algorithm(entry: _Entry) -> None:
    """Prints one algorithm with a row for each of its settings."""
    package = entry["package"] or "in no package"
    rows = [(s["name"], _text(s["default"]), s["description"]) for s in entry["settings"]]
    if entry["description"]:
        output.say(entry["description"])

    title = f"{entry['name']}: {package}, engine {entry['engine']}"
    output.table(title, ("setting", "default", "meaning"), rows)
    for sentence in _other_defaults(entry["name"]):
        output.say(sentence)

    output.document({"algorithms": [entry], "broken": []})


def _other_defaults(algorithm: str) -> Iterator[str]:
    """Yields the defaults of each other source of jbench's settings, such as `suite`."""
    if algorithm not in SETTINGS:
        return

    kind = SETTINGS[algorithm]
    for base, values in kind.bases.items():
        if base == "published":
            continue

        option = f"--settings {base}"
        if base == "suite":
            option += " (the default on other robots than the Jitterbug)"
        changed = [
            f"{name}={_text(value)}"
            for name, value in values.items()
            if value != kind.model_fields[name].get_default(call_default_factory=True)
        ]
        yield f"With {option}: {', '.join(changed) or 'the same'}."


def tasks(
    name: str | None = Argument(
        None,
        help="Only this task, or MODULE:NAME, with the parts of its observation.",
        autocompletion=options.complete_tasks,
    ),
    json: bool = options.JSON,
) -> None:
    """List the installed tasks with the sizes of observation and action."""
    from jbench.tasks.find import checked_task, find_task, installed_tasks

    columns = {
        "--task": "name",
        "meaning": "description",
        "observation": "observation_size",
        "actions": "action_size",
        "control timestep (s)": "control_timestep",
    }

    def describe(task_name: str) -> _Entry:
        task = find_task(task_name)
        return {
            "name": task_name,
            **{name: getattr(task, name) for name in columns.values() if name != "name"},
            "parts": dict(task.parts),
            "episode_steps": task.episode_steps,
        }

    if name is not None:
        task = checked_task(name)
        output.note_task(task)
        entry = describe(name)
        if entry["description"]:
            output.say(entry["description"])
        title = f"{name}: {counted(entry['action_size'], 'action')}"
        output.table(title, ("part", "size"), list(entry["parts"].items()))
        output.say(f"An episode has {task.length_in_words}.")
        output.document({"tasks": [entry], "broken": []})
        return

    listed = [*names.TASKS, *installed_tasks()]
    if importlib.util.find_spec("dm_control") is not None:
        listed += task_specs.SUITE_TASKS

    hint = "jbench tasks NAME shows the parts of an observation, and tries the task."
    _list("task", listed, describe, columns, hint)


def datasets(results: Path = options.READ_RESULTS, json: bool = options.JSON) -> None:
    """List datasets."""
    from jbench.datasets import Dataset

    records, problems = parsing.results_to_read(results).scan("dataset")
    rows = []
    entries = []
    for record in records:
        try:
            dataset = Dataset(record)
        except RequestError as error:
            problems.append(str(error))
            continue

        steps = dataset.control_steps
        more = {"status": record.status, "steps": steps, "bytes": record.size}
        entries.append(output.described(record, **more))
        row = {
            "dataset": record.id,
            "status": record.status,
            "steps": progress_text(steps, dataset.settings.steps),
            "robot": dataset.settings.robot_in_words,
            "MB": f"{record.size / 1e6:.1f}",
            "last written (UTC)": record.manifest.updated[:16].replace("T", " "),
        }
        rows.append(row)

    if rows:
        title = f"{counted(len(rows), 'dataset')} in {results}"
        cells = [list(row.values()) for row in rows]
        output.table(title, list(rows[0]), cells, spare=("last written (UTC)", "robot", "MB"))
    elif not problems:
        small = with_results("jbench collect --steps 100000", parsing.writable(results))
        output.say(f"No datasets in {results}; {small} makes a small one.")

    output.document({"datasets": entries, "problems": problems})
    output.warn_of_damage(problems)


def _list(
    noun: str, listed: Iterable[str], describe: Callable[[str], _Entry], columns: _Entry, hint: str
) -> None:
    """Prints a table of what is installed; raises a WorkError if some of it can't be used."""
    entries = []
    broken = []
    for name in listed:
        try:
            entries.append(describe(name))
        except (RequestError, WorkError) as error:
            broken.append({"name": name, "error": str(error)})
            output.warn(str(error))

    if not any(entry["description"] for entry in entries):
        columns = {title: name for title, name in columns.items() if name != "description"}
    rows = ([_cell(entry[name]) for name in columns.values()] for entry in entries)
    spare = ("package", "engine", "meaning")
    output.table(f"{noun.capitalize()}s", list(columns), rows, spare=spare)
    output.say(hint)
    output.document({f"{noun}s": entries, "broken": broken})
    if broken:
        raise WorkError(f"{counted(len(broken), noun)} can't be used; see above.")


def _cell(value: Any) -> Any:
    """Returns a value as the table shows it; settings with their defaults."""
    if isinstance(value, list):
        return ", ".join(f"{setting['name']}={_text(setting['default'])}" for setting in value)
    return value


def _text(value: Any) -> str:
    """Returns a value as it is typed after `--set NAME=`."""
    return value if isinstance(value, str) else dumps(value, separators=(",", ":"))
