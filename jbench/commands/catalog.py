"""Commands that list what is installed: algorithms, tasks."""

import importlib.util
from collections.abc import Callable, Iterable, Mapping
from json import dumps
from typing import Any

from typer import Argument

from jbench import names, task_specs
from jbench.commands import completion, options
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.settings.algorithms import ALGORITHMS
from jbench.wording import counted


def algorithms(
    name: str | None = Argument(None, help="Only this one, or MODULE:CLASS, and its settings."),
    json: bool = options.JSON,
) -> None:
    """List the installed algorithms with their settings."""
    from jbench import plugins
    from jbench.agents import algorithms as known

    def describe(algorithm: str) -> dict[str, Any]:
        ours = algorithm in ALGORITHMS
        code = plugins.made_with("jbench") if ours else known.algorithm_provenance(algorithm)
        return {
            "name": algorithm,
            "engine": known.choose_engine(algorithm),
            "package": code.get("package"),
            "settings": [
                {"name": setting, "default": default, "description": description}
                for setting, (default, description) in known.describe_settings(algorithm).items()
            ],
        }

    output = Output(json)
    if name is not None:
        entry = describe(name)
        rows = [(s["name"], _text(s["default"]), s["description"]) for s in entry["settings"]]
        title = f"{name}: {entry['package'] or 'in no package'}, engine {entry['engine']}"
        output.table(title, ("setting", "default", "meaning"), rows)
        output.document({"algorithms": [entry], "broken": []})
        return

    columns = {"--algo": "name", "engine": "engine", "package": "package", "settings": "settings"}
    hint = "jbench algorithms NAME explains the settings of one; --set changes them."
    _list("algorithm", (*ALGORITHMS, *known.installed()), describe, columns, hint, output)


def tasks(
    name: str | None = Argument(
        None,
        help="Only this task, or MODULE:NAME, with the parts of its observation.",
        autocompletion=completion.complete_tasks,
    ),
    json: bool = options.JSON,
) -> None:
    """List the installed tasks with the sizes of observation and action."""
    from jbench.simulation.find import checked_task, find_task, installed_tasks

    def describe(task_name: str) -> dict[str, Any]:
        task = find_task(task_name)
        return {
            "name": task_name,
            "observation_size": task.observation_size,
            "action_size": task.action_size,
            "control_timestep": task.control_timestep,
            "parts": dict(task.parts),
        }

    output = Output(json)
    if name is not None:
        checked_task(name)
        entry = describe(name)
        title = f"{name}: {counted(entry['action_size'], 'action')}"
        output.table(title, ("part", "size"), list(entry["parts"].items()))
        output.document({"tasks": [entry], "broken": []})
        return
    suite = task_specs.SUITE_TASKS if importlib.util.find_spec("dm_control") else ()
    columns = {"--task": "name", "observation": "observation_size", "actions": "action_size"}
    columns["control timestep (s)"] = "control_timestep"
    hint = "jbench tasks NAME shows the parts of an observation, and tries the task."
    _list("task", (*names.TASKS, *installed_tasks(), *suite), describe, columns, hint, output)


def _list(
    noun: str,
    listed: Iterable[str],
    describe: Callable[[str], dict[str, Any]],
    columns: Mapping[str, str],
    hint: str,
    output: Output,
) -> None:
    """Prints a table of what is installed; raises a WorkError if some of it can't be used."""
    entries, broken = [], []
    for name in listed:
        try:
            entries.append(describe(name))
        except (RequestError, WorkError) as error:
            broken.append({"name": name, "error": str(error)})
            output.warn(str(error))
    rows = ([_cell(entry[name]) for name in columns.values()] for entry in entries)
    output.table(f"{noun.capitalize()}s", list(columns), rows)
    output.say(hint)
    output.document({f"{noun}s": entries, "broken": broken})
    if broken:
        raise WorkError(f"{counted(len(broken), noun)} can't be used; see above.")


def _cell(value: Any) -> Any:
    is_settings = isinstance(value, list)
    return ", ".join(f"{s['name']}={_text(s['default'])}" for s in value) if is_settings else value


def _text(value: Any) -> str:
    """Returns a value as it is typed after `--set NAME=`."""
    return value if isinstance(value, str) else dumps(value, separators=(",", ":"))
