"""The tasks command."""

import importlib.util
from typing import Any

from typer import Argument

from jbench import names, task_specs
from jbench.commands import options
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.wording import counted


def tasks(
    name: str | None = Argument(
        None,
        help="Only this task, or MODULE:NAME, with the parts of its observation.",
        autocompletion=options.complete_tasks,
    ),
    json: bool = options.JSON,
) -> None:
    """List the installed tasks with the sizes of observation and action."""
    from jbench.simulation.find import checked_task, installed_tasks

    output = Output(json)
    listed, broken = [], []
    if name is None:
        suite = task_specs.SUITE_TASKS if importlib.util.find_spec("dm_control") else ()
        for task in (*names.TASKS, *installed_tasks(), *suite):
            try:
                listed.append(_described(task))
            except (RequestError, WorkError) as error:
                broken.append({"name": task, "error": str(error)})
                output.warn(str(error))
        rows = [
            (t["name"], str(t["observation_size"]), str(t["action_size"]), _seconds(t))
            for t in listed
        ]
        output.table("Tasks", ("--task", "observation", "actions", "control timestep"), rows)
        output.say("jbench tasks NAME shows the parts of an observation, and tries the task.")
    else:
        checked_task(name)
        listed.append(_described(name))
        parts = [(part, str(size)) for part, size in listed[0]["parts"].items()]
        title = f"{name}: {counted(listed[0]['action_size'], 'action')}"
        output.table(title, ("part", "size"), parts)
    output.document({"tasks": listed, "broken": broken})
    if broken:
        raise WorkError(f"{counted(len(broken), 'task')} can't be used; see above.")


def _described(name: str) -> dict[str, Any]:
    """Returns the entry of a task in the JSON document.

    Raises:
        RequestError, WorkError: see `jbench.simulation.find_task`.
    """
    from jbench.simulation import find_task

    task = find_task(name)
    return {
        "name": name,
        "observation_size": task.observation_size,
        "action_size": task.action_size,
        "control_timestep": task.control_timestep,
        "parts": dict(task.parts),
    }


def _seconds(task: dict[str, Any]) -> str:
    timestep = task["control_timestep"]
    return "" if timestep is None else f"{timestep:g} s"
