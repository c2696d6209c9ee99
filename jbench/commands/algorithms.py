"""The algorithms command."""

from json import dumps
from typing import Any

from typer import Argument

from jbench.commands import options
from jbench.commands.output import Output
from jbench.errors import WorkError
from jbench.wording import counted


def algorithms(
    name: str | None = Argument(
        None, help="Only this algorithm, or MODULE:CLASS, with its settings' meaning."
    ),
    json: bool = options.JSON,
) -> None:
    """List the installed algorithms with their settings."""
    from jbench.agents.algorithms import installed
    from jbench.settings.algorithms import ALGORITHMS

    output = Output(json)
    listed, broken = [], []
    for algorithm in (*ALGORITHMS, *installed()) if name is None else (name,):
        try:
            listed.append(_described(algorithm))
        except WorkError as error:
            broken.append({"name": algorithm, "error": str(error)})
            output.warn(str(error))
    if name is None:
        rows = [
            (a["name"], a["engine"], a["package"], ", ".join(map(_assignment, a["settings"])))
            for a in listed
        ]
        output.table("Algorithms", ("--algo", "engine", "package", "settings"), rows)
        output.say("jbench algorithms NAME explains the settings of one; --set changes them.")
    elif listed:
        _show_settings(listed[0], output)
    output.document({"algorithms": listed, "broken": broken})
    if broken:
        raise WorkError(f"{counted(len(broken), 'algorithm')} can't be loaded; see above.")


def _described(name: str) -> dict[str, Any]:
    """Returns the entry of an algorithm in the JSON document.

    Raises:
        RequestError: if there is no such algorithm.
        WorkError: if its package can't be imported.
    """
    from jbench import plugins
    from jbench.agents.algorithms import algorithm_provenance, choose_engine, describe_settings
    from jbench.settings.algorithms import ALGORITHMS

    code = plugins.made_with("jbench") if name in ALGORITHMS else algorithm_provenance(name)
    return {
        "name": name,
        "engine": choose_engine(name),
        "package": code.get("package"),
        "settings": [
            {"name": setting, "default": default, "description": description}
            for setting, (default, description) in describe_settings(name).items()
        ],
    }


def _show_settings(algorithm: dict[str, Any], output: Output) -> None:
    rows = [(s["name"], _text(s["default"]), s["description"]) for s in algorithm["settings"]]
    package = algorithm["package"] or "in no package"
    title = f"{algorithm['name']}: {package}, engine {algorithm['engine']}"
    output.table(title, ("setting", "default", "meaning"), rows)


def _assignment(setting: dict[str, Any]) -> str:
    return f"{setting['name']}={_text(setting['default'])}"


def _text(value: Any) -> str:
    """Returns a value as it is typed after `--set NAME=`."""
    return value if isinstance(value, str) else dumps(value, separators=(",", ":"))
