"""Options: those that several commands share, their completion, and those made from settings."""

import importlib.metadata
import inspect
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from glob import escape, glob
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import typer
from pydantic.fields import FieldInfo
from typer import Argument, Option

from jbench import names, task_specs
from jbench.commands import parsing
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.base import Settings, typed_default

_Command = Callable[..., None]


def with_settings(
    kind: type[Settings], *fields: str, main: Sequence[str] = ()
) -> Callable[[_Command], _Command]:
    """Returns a decorator that gives a command an option for each of some fields of settings.

    The command takes their values as keyword arguments by the names of the fields.

    Args:
        kind: settings, whose fields have the type, description, default and unit.
        fields: names of the fields.
        main: names of the parameters that everybody needs; the help lists the others, those of the
            command included, as "Advanced". If empty, they are one list.
    """

    def decorate(command: _Command) -> _Command:
        signature = inspect.signature(command, eval_str=True)
        typed = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        parameters = [*typed, *(_parameter(name, kind.model_fields[name]) for name in fields)]
        for i, parameter in enumerate(parameters):
            if main and parameter.name not in main:
                option = copy(parameter.default)
                option.rich_help_panel = "Advanced"
                parameters[i] = parameter.replace(default=option)
        command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        return command

    return decorate


def like(command: _Command, *left_out: str) -> Callable[[_Command], _Command]:
    """Returns a decorator that gives a command the options of another one but for some."""

    def decorate(narrower: _Command) -> _Command:
        parameters = inspect.signature(command).parameters.values()
        kept = [parameter for parameter in parameters if parameter.name not in left_out]
        narrower.__signature__ = inspect.Signature(kept)  # type: ignore[attr-defined]
        return narrower

    return decorate


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """Returns the parameter of a command for a field of settings."""
    default, help = typed_default(field), str(field.description)
    extra, type_ = field.json_schema_extra, _plain(field.annotation)
    unit = extra.get("unit") if isinstance(extra, dict) else None
    option = Option(
        f"{default:_}" if unit and default is not None else default,
        f"--{(field.title or name).replace('_', '-')}",
        help=f"{help[0].upper()}{help[1:]}.",
        metavar=str(unit).split()[-1].upper() if unit else None,
        parser=parsing.count if unit else None,
    )
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=option,
        annotation=type_ | None if default is None else type_,
    )


def _plain(annotation: Any) -> Any:
    """Returns a type without None and without limits, which the settings check."""
    wrapped = get_origin(annotation) in (Annotated, Union, UnionType)
    return _plain(get_args(annotation)[0]) if wrapped else annotation


def complete(*known: str) -> Callable[[str], list[str]]:
    """Returns a shell completion that offers the names with the typed prefix."""
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


def complete_tasks(incomplete: str) -> list[str]:
    """Offers the Jitterbug's tasks, installed ones, and those of dm_control's suite."""
    points = importlib.metadata.entry_points(group=task_specs.TASK_GROUP)
    return complete(*names.TASKS, *sorted(p.name for p in points), *task_specs.SUITE_TASKS)(
        incomplete
    )


def complete_records(kind: str, *known: str) -> Callable[[typer.Context, str], list[str]]:
    """Returns a completion that offers the names, and the ids of records in --results."""

    def offer(context: typer.Context, incomplete: str) -> list[str]:
        ids = _ids(Path(context.params.get("results") or names.RESULTS), kind)
        return complete(*known, *ids)(incomplete)

    return offer


def complete_policies(context: typer.Context, incomplete: str) -> list[str]:
    """Offers hand-written policies, runs of --results, and shipped policies."""
    shipped = _ids(Path(names.REFERENCE), "run", "policy*.json")
    known = names.HEURISTIC, "random", "constant:1", *(f"{names.REFERENCE}/{id}" for id in shipped)
    return complete_records("run", *known)(context, incomplete)


def complete_encoders(context: typer.Context, incomplete: str) -> list[str]:
    """Offers the representations of the encoders in --results, and their ids after a slash."""
    ids = complete_records("encoder")(context, incomplete if "/" in incomplete else "")
    representations = sorted({id.split("/")[1] for id in ids if id.count("/") > 1})
    return ids if "/" in incomplete else complete("none", *representations)(incomplete)


def complete_results(incomplete: str) -> list[str]:
    """Offers the shipped results and directories."""
    directories = (name for name in glob(f"{escape(incomplete)}*") if Path(name).is_dir())
    return [*complete(names.REFERENCE)(incomplete), *sorted(directories)]


def complete_settings(context: typer.Context, incomplete: str) -> list[str]:
    """Offers the hyperparameters of the typed algorithm of jbench."""
    from jbench.settings.algorithms import SETTINGS

    settings = SETTINGS.get(context.params.get("algo") or "ddpg")
    return complete(*(f"{name}=" for name in getattr(settings, "model_fields", ())))(incomplete)


def _ids(results: Path, kind: str, file: str = "manifest.json") -> list[str]:
    """Returns the ids of records with such a file; results need not exist."""
    if names.is_reference(results):
        results = Path(__file__).parents[1] / names.REFERENCE
    root = results / f"{kind}s"
    return sorted(path.parent.relative_to(root).as_posix() for path in root.rglob(file))


def path(text: str | Path) -> Path:
    """Returns a path as typed; an empty one, as of an unset shell variable, is refused."""
    if not str(text):
        raise typer.BadParameter("it is empty; type . for the working directory")
    return Path(text)


RESULTS = Option(
    Path(names.RESULTS), "--results", parser=path, metavar="DIR", help="Results directory."
)
READ_RESULTS = Option(
    Path(names.RESULTS),
    "--results",
    parser=path,
    metavar="DIR",
    help=f"Results directory ({names.REFERENCE}: the results shipped with jbench).",
    autocompletion=complete_results,
)
JSON = Option(False, "--json", help="Print one JSON document to stdout, everything else to stderr.")
CSV = Option(False, "--csv", help="Print CSV to standard output.")
DRY_RUN = Option(
    False, "--dry-run", help="Show the status of the runs and the time left, and train nothing."
)
KEEP_STATE = Option(
    False,
    "--keep-state",
    help="Keep the last checkpoint of finished runs, with the replay buffer, so that the same "
    "command with more --steps continues them.",
)
RETRY_FAILED = Option(False, "--retry-failed", help="Retry runs that failed before.")
LOG = Option(
    None, help=f"Also write the rows to an experiment tracker: {', '.join(names.LOGGERS)}."
)
JOBS = Option(
    0,
    min=0,
    help="Number of worker processes (0: one per core, or one for a GPU, which trains all seeds of "
    "a configuration in one process).",
)
THREADS = Option(0, min=0, help="Number of threads (0: one per core).")
FINAL_EPISODES = Option(
    None,
    min=1,
    help="Episodes of a run's last evaluation (default: 100, but not more than the run has "
    "training episodes).",
)
AUGMENT = Option(None, min=0, help="Seed of an augmented robot (default: the plain robot).")
DATASET = Option(
    None,
    help="Id of the dataset (default: the newest).",
    autocompletion=complete_records("dataset"),
)
_task = partial(
    Option,
    help=f"Task: {', '.join(names.TASKS)}, {task_specs.SUITE}DOMAIN-TASK of dm_control's suite, "
    "one of another package (jbench tasks), or MODULE:NAME of a function that returns a "
    "dm_env.Environment.",
    autocompletion=complete_tasks,
)
TASK, REQUIRED_TASK = _task("face_direction"), _task(...)
POLICY_TASK = Option(
    None,
    help="Task (default: the task of a trained policy; of other policies, evaluate takes "
    "face_direction, render and view move_to_pose).",
    autocompletion=complete_tasks,
)
ONE_TASK = Option(None, help="Only this task.", autocompletion=complete_tasks)
ONE_ALGORITHM = Option(None, help="Only this algorithm.", autocompletion=complete(*ALGORITHMS))
ONE_REPRESENTATION = Option(None, help="Only this representation: full, or one such as dae12.")
ONE_STATUS = Option(None, help=f"Only runs of this status: {', '.join(names.STATUSES)}.")
SOME_SEEDS = Option(None, "--seeds", "--seed", help="Only these seeds, such as 0-9 or 0,2,5-7.")
POLICY = Argument(
    None,
    metavar="POLICY",
    help=f"Policy: {names.POLICY_NAMES} (default: {names.HEURISTIC}).",
    autocompletion=complete_policies,
)
OLD_POLICY = Option(None, "--policy", hidden=True)
"""How POLICY was typed in older versions."""
CAMERA = Option(
    None,
    help=f"Camera: {', '.join(names.CAMERAS)} (default: tracking), or one of another robot's model "
    "(default: its first).",
    autocompletion=complete(*names.CAMERAS),
)
