"""Commands that list what is installed: algorithms, tasks."""

import importlib.util
from collections.abc import Callable, Iterable, Sequence
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
    name: str | None = Argument(
        None, help="Only this algorithm, or MODULE:CLASS, with its settings' meaning."
    ),
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
    if name is None:

        def cells(entry: dict[str, Any]) -> tuple[Any, ...]:
            settings = (f"{s['name']}={_text(s['default'])}" for s in entry["settings"])
            return entry["name"], entry["engine"], entry["package"], ", ".join(settings)

        header = "--algo", "engine", "package", "settings"
        hint = "jbench algorithms NAME explains the settings of one; --set changes them."
        listed = *ALGORITHMS, *known.installed()
        _list("algorithm", listed, describe, header, cells, hint, output)
    else:
        entry = describe(name)
        package = entry["package"] or "in no package"
        rows = [(s["name"], _text(s["default"]), s["description"]) for s in entry["settings"]]
        title = f"{name}: {package}, engine {entry['engine']}"
        output.table(title, ("setting", "default", "meaning"), rows)
        output.document({"algorithms": [entry], "broken": []})


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
    if name is None:
        suite = task_specs.SUITE_TASKS if importlib.util.find_spec("dm_control") else ()

        def cells(entry: dict[str, Any]) -> tuple[Any, ...]:
            timestep = entry["control_timestep"]
            seconds = "" if timestep is None else f"{timestep:g} s"
            return entry["name"], entry["observation_size"], entry["action_size"], seconds

        header = "--task", "observation", "actions", "control timestep"
        hint = "jbench tasks NAME shows the parts of an observation, and tries the task."
        listed = *names.TASKS, *installed_tasks(), *suite
        _list("task", listed, describe, header, cells, hint, output)
    else:
        checked_task(name)
        entry = describe(name)
        title = f"{name}: {counted(entry['action_size'], 'action')}"
        output.table(title, ("part", "size"), list(entry["parts"].items()))
        output.document({"tasks": [entry], "broken": []})


def _list(
    noun: str,
    listed: Iterable[str],
    describe: Callable[[str], dict[str, Any]],
    header: Sequence[str],
    cells: Callable[[dict[str, Any]], Sequence[Any]],
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
    output.table(f"{noun.capitalize()}s", header, map(cells, entries))
    output.say(hint)
    output.document({f"{noun}s": entries, "broken": broken})
    if broken:
        raise WorkError(f"{counted(len(broken), noun)} can't be used; see above.")


def _text(value: Any) -> str:
    """Returns a value as it is typed after `--set NAME=`."""
    return value if isinstance(value, str) else dumps(value, separators=(",", ":"))
