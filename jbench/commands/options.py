"""Shared options, options made from the fields of a class, and values that the shell offers."""

import importlib.metadata
import inspect
import math
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from glob import escape, glob
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from typer import Argument, Context, Option

from jbench import names, task_specs
from jbench.commands import parsing
from jbench.cores import cores
from jbench.settings.algorithms import ALGORITHMS, SETTINGS
from jbench.settings.base import extra, task_and_representation, typed_default

_Verb = Callable[..., None]


def with_settings(
    kind: type[BaseModel], *chosen: str, main: Sequence[str] = ()
) -> Callable[[_Verb], _Verb]:
    """Returns a decorator that gives a command an option for each of some fields of a model.

    The command takes their values as keyword arguments by the names of the fields. These have type,
    description, default and unit. Parameters that are not `main` ones, those of the command
    included, are listed as "Advanced" by the help, unless `main` is empty.
    """

    def decorate(command: _Verb) -> _Verb:
        signature = inspect.signature(command, eval_str=True)
        *typed, _ = signature.parameters.values()  # the last one takes the chosen fields
        parameters = [*typed, *(_parameter(name, kind.model_fields[name]) for name in chosen)]
        for i, parameter in enumerate(parameters):
            if main and parameter.name not in main:
                option = copy(parameter.default)
                option.rich_help_panel = "Advanced"
                parameters[i] = parameter.replace(default=option)

        command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        return command

    return decorate


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """Returns the option of a setting: its flag, help, unit and default."""
    default = typed_default(field)
    help = str(field.description)
    type_ = _plain(field.annotation)
    unit = extra(field).get("unit")
    metavar = None
    if unit:
        metavar = str(unit).split()[-1].upper()

    parser: Callable[[str], int] | None = None
    if type_ is int and unit:
        parser = parsing.count
    elif type_ is int:  # the settings say how large it may be
        parser = partial(parsing.count, least=0, most=math.inf)
    if default is PydanticUndefined:  # it must be typed
        default = ...
    elif default is None:
        type_ |= None
    elif unit:
        default = f"{default:_}"

    option = Option(
        default,
        f"--{(field.title or name).replace('_', '-')}",
        help=f"{help[0].upper()}{help[1:]}.",
        metavar=metavar,
        parser=parser,
    )
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=option, annotation=type_)


def _plain(annotation: Any) -> Any:
    """Returns a type without None and without limits, which the settings check."""
    if get_origin(annotation) in (Annotated, Union, UnionType):
        return _plain(get_args(annotation)[0])
    return annotation


def complete_tasks() -> list[str]:
    """Offers all tasks that have names; typer leaves out those without the typed beginning."""
    points = importlib.metadata.entry_points(group=task_specs.TASK_GROUP)
    return [*names.TASKS, *sorted(point.name for point in points), *task_specs.SUITE_TASKS]


def complete_policies(context: Context) -> list[str]:
    """Offers hand-written policies, runs of --results, and shipped policies."""
    policies = _ids(names.SHIPPED_RESULTS, "run", "policy*.json")
    shipped = [f"{names.REFERENCE}/{id}" for id in policies]
    return [names.HEURISTIC, "random", "constant:1", *shipped, *_ids(_typed(context), "run")]


def complete_encoders(context: Context, incomplete: str) -> list[str]:
    """Offers the representations of the encoders in --results, and their ids after a slash."""
    ids = _ids(_typed(context), "encoder")
    if "/" in incomplete:
        return ids

    whole = [id for id in ids if id.count("/") > 1]
    representations = sorted({task_and_representation(id)[1] for id in whole})
    return ["none", *representations]


def complete_datasets(context: Context) -> list[str]:
    """Offers the ids of the datasets in --results."""
    return _ids(_typed(context), "dataset")


def _directories(incomplete: str) -> list[str]:
    """Returns what completes the name of a results directory."""
    directories = (name for name in glob(f"{escape(incomplete)}*") if Path(name).is_dir())
    return [names.REFERENCE, *sorted(directories)]


def _hyperparameters(context: Context) -> list[str]:
    """Returns what completes --set: the settings of the algorithm that was typed."""
    settings = SETTINGS.get(context.params.get("algo") or "ddpg")
    return [f"{name}=" for name in getattr(settings, "model_fields", ())]


def _typed(context: Context) -> Path:
    """Returns the results directory of a command line."""
    results = Path(context.params.get("results") or names.RESULTS)
    if names.is_reference(results):
        return names.SHIPPED_RESULTS
    return results


def _ids(results: Path, kind: str, file: str = "manifest.json") -> list[str]:
    """Returns the ids of records with a file in a results directory, which need not exist."""
    root = results / f"{kind}s"
    return sorted(path.parent.relative_to(root).as_posix() for path in root.rglob(file))


def whole_number(
    default: int | None,
    *flags: str,
    unit: str,
    help: str,
    least: int = 0,
    most: int = names.MAX_COUNT,
    **more: Any,
) -> Any:
    """Returns an option of a whole number, at least 0 or 1, which may be typed as 1k or 1e3."""
    parser = partial(parsing.count, least=least, most=most)
    return Option(default, *flags, parser=parser, metavar=unit, help=help, **more)


def number(
    default: float | None, *flags: str, unit: str, help: str, least: float = -math.inf
) -> Any:
    """Returns an option of a number."""
    parser = partial(parsing.number, least=least)
    return Option(default, *flags, parser=parser, metavar=unit, help=help)


_results = partial(Option, Path(names.RESULTS), "--results", parser=parsing.path, metavar="DIR")
RESULTS = _results(help="Results directory.")
READ_RESULTS = _results(
    help=f"Results directory ({names.REFERENCE}: the results shipped with jbench).",
    autocompletion=_directories,
)
# `cli.main` looks for it before the command begins.
JSON = Option(False, "--json", help="Print one JSON document to stdout, everything else to stderr.")
CSV = Option(False, "--csv", help="Print CSV to standard output.")
_DRY_RUN = "Show the runs' status and the time left; train nothing."
DRY_RUN = Option(False, "--dry-run", help=_DRY_RUN)
DRY_RUN_OR_STATUS = Option(False, "--dry-run", "--status", help=_DRY_RUN)
KEEP_STATE = Option(
    False,
    "--keep-state",
    help="Keep the last checkpoint of finished runs, with the replay buffer, so that the same "
    "command with more --steps continues them.",
)
KEEP_COMPACT_STATE = Option(
    False,
    "--keep-compact-state",
    help="Like --keep-state, with actions instead of the replay buffer, which is computed again "
    "when a run is continued.",
)
_accept_changed_code = partial(Option, False, "--accept-changed-code")
_ACCEPTED = (
    "use the present code of your task, encoder or algorithm also for records of older code, and "
    "mark what comes of it."
)
ACCEPT_CHANGED_CODE = _accept_changed_code(help=_ACCEPTED.capitalize())
ACCEPT_CHANGED_CODE_TO_REEVALUATE = _accept_changed_code(help=f"With --reevaluate: {_ACCEPTED}")
RETRY_FAILED = Option(False, "--retry-failed", help="Retry runs that failed before.")
LOG = Option(None, help=f"Also write rows to an experiment tracker: {', '.join(names.LOGGERS)}.")
CHECKPOINT_EVERY = number(
    names.CHECKPOINT_EVERY,
    unit="SECONDS",
    least=0,
    help="Minimum seconds between checkpoints of a run of the batched engine; each is at the end "
    "of an episode.",
)
_DEVICES = "auto (a GPU if there is one), cpu, cuda or such as cuda:1."
_device = partial(Option, "auto", autocompletion=lambda: names.DEVICES)
DEVICE = _device(help=f"Device to train on, by the batched engine: {_DEVICES}")
DEVICE_OF_ENCODER = _device(help=f"Device to train on: {_DEVICES}")
_set = partial(Option, [], "--set", metavar="NAME=VALUE")
SET = _set(
    help="Set a hyperparameter (jbench algorithms NAME lists them), or with --encoder ofeN "
    "ofe.NAME=VALUE; repeatable.",
    autocompletion=_hyperparameters,
)
SET_OF_ENCODER = _set(help="Set an option of the kind of encoder, such as rescale; repeatable.")
SET_OF_CODE = _set(
    help="Set a hyperparameter of an agent or an update rule, or an option of a kind of encoder; "
    "repeatable."
)
JOBS = whole_number(
    0,
    unit="JOBS",
    help="Number of worker processes (0: one per core; on a GPU, where each trains all seeds of a "
    "configuration, one per five cores).",
)
_threads = partial(whole_number, 0, unit="THREADS", callback=lambda number: number or cores())
THREADS = _threads(help="Number of threads (0: one per core).")
FILES = _threads(help="Number of records checked at a time (0: one per core).")
FINAL_EPISODES = whole_number(
    None,
    unit="EPISODES",
    least=1,
    help="Episodes of a run's last evaluation (default: 100, or as many as it trains, if fewer; "
    "with the default evaluations of a run of less than 200 episodes, half as many).",
)
AUGMENT = whole_number(
    None,
    unit="SEED",
    most=names.MAX_SEED,
    help="Seed of an augmented robot (default: the plain robot).",
)
DATASET = Option(
    None,
    help="Id of the dataset (default: newest).",
    autocompletion=complete_datasets,
)
some_task = partial(Option, autocompletion=complete_tasks)
_task = partial(
    some_task,
    help=f"Task: {', '.join(names.TASKS)}, {task_specs.SUITE}DOMAIN-TASK of dm_control's suite, "
    f"{task_specs.GYM}ID of Gymnasium, one of another package (jbench tasks), or MODULE:NAME of a "
    "function that returns a dm_env.Environment or a gymnasium.Env.",
)
TASK = _task("face_direction")
REQUIRED_TASK = _task(...)
POLICY_TASK = some_task(
    None,
    help="Task (default: the task of a trained policy; of other policies, evaluate takes "
    "face_direction, render and view move_to_pose).",
)
ONE_TASK = some_task(None, help="Only this task.")
ONE_ALGORITHM = Option(None, help="Only this algorithm.", autocompletion=lambda: ALGORITHMS)
SOME_ALGORITHMS = Option(
    [],
    "--algo",
    metavar="ALGO",
    help="Only this algorithm, or these, with commas; repeatable.",
    autocompletion=lambda: ALGORITHMS,
)
ONE_REPRESENTATION = Option(
    None, help="Only this representation, such as full or dae12, or all of a kind, such as dae."
)
ONE_STATUS = Option(None, help=f"Only runs of this status: {', '.join(names.STATUSES)}.")
SOME_SEEDS = Option(None, "--seeds", "--seed", help="Only these seeds, such as 0-9 or 0,2,5-7.")
POLICY = Argument(
    None,
    metavar="POLICY",
    help=f"Policy: {names.POLICY_NAMES} (default: {names.HEURISTIC}).",
    autocompletion=complete_policies,
)
