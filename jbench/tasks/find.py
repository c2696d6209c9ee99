"""Tasks by name: the Jitterbug's, those of dm_control's suite, and those of other packages."""

import copyreg
import importlib.util
import logging
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache, partial
from importlib.metadata import EntryPoint
from typing import Any

from jbench import plugins
from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.settings.specs import CODE_CHECKSUMS, MADE_BY_CODE, Specs
from jbench.sources import source_files
from jbench.task_specs import GYM, SUITE, SUITE_TASKS, TASK_GROUP
from jbench.tasks import gym_registry
from jbench.tasks.environment_task import EnvironmentTask
from jbench.tasks.jitterbug.task import JitterbugTask
from jbench.tasks.own_pictures import RENDER_MODE
from jbench.tasks.task import Task
from jbench.typed_values import closest
from jbench.wording import in_prose

EPISODES_REPEAT = "episodes_repeat"
"""Key of provenance: false if the same seed and actions made another episode."""

_NAME = re.compile(r"[a-z][a-z0-9_-]*")


def installed_tasks() -> dict[str, EntryPoint]:
    """Returns the entry points of the tasks of other packages by name."""
    return dict(sorted(plugins.offered(TASK_GROUP, _NAME, TASKS).items()))


@lru_cache(maxsize=64)
def find_task(name: str) -> Task:
    """Returns a task by name.

    It is one of `jbench.names.TASKS`, dmc:DOMAIN-TASK of dm_control's suite, gym:ID of Gymnasium's
    registry, to which arguments of `gymnasium.make` may be added as in gym:Pendulum-v1,g=9.8, an
    installed task, or MODULE:NAME of a factory, which returns a `dm_env.Environment` or a
    `gymnasium.Env`.

    Raises:
        RequestError: if there is no such task, or jbench can't use it.
        WorkError: if the package of the task can't be imported.
    """
    if name in TASKS:
        return JitterbugTask(name)
    if name.startswith(SUITE):
        return _suite_task(name)
    if name.startswith(GYM):
        environment = gym_registry.find_environment(name)
        return EnvironmentTask(
            name,
            lambda seed: environment.make(),
            files=environment.files or None,
            description=environment.description,
            provenance=lambda: gym_registry.code_provenance(name),
            draw=lambda seed: environment.make(render_mode=RENDER_MODE),
        )
    if plugins.is_imported(name):
        factory = plugins.imported("task", name)
        return _made_by(name, factory, source_files(name.partition(":")[0]))

    point = installed_tasks().get(name)
    if point is None:
        raise unknown_task(name)

    return _made_by(name, plugins.load("task", point), source_files(point.module))


def _copied(task: EnvironmentTask) -> Any:
    """Returns how a task is copied: by its name, since what makes environments can't be copied."""
    return find_task, (task.name,)


copyreg.pickle(EnvironmentTask, _copied)


@lru_cache(maxsize=64)
def checked_task(name: str) -> Task:
    """Returns a task, see `find_task`, after `EnvironmentTask.check` if it is none of jbench's."""
    task = find_task(name)
    if isinstance(task, EnvironmentTask):
        task.check()
    return task


def check_specs(name: str, recorded: Specs | None, accept_changed: bool = False) -> None:
    """Raises a RequestError if a task has another robot, observation or action than recorded.

    If changed code is accepted, only observation and action count. The checksums of the code are
    compared by `jbench.store.code`.
    """
    now = find_task(name).specs
    left_out = (*CODE_CHECKSUMS, *MADE_BY_CODE) if accept_changed else CODE_CHECKSUMS
    names = [name for name in Specs.model_fields if name not in left_out]
    fields = [name for name in names if getattr(now, name, None) != getattr(recorded, name, None)]
    if not fields:
        return

    raise RequestError(
        f"The task {name} has changed since it was recorded: its {in_prose(fields, 'and')} differ; "
        "use the task's code of that time, or train again."
    )


def task_provenance(name: str) -> dict[str, Any]:
    """Returns `Task.code_provenance` of a task. Raises as `find_task`."""
    return find_task(name).code_provenance()


def files_at_hand(name: str, recorded: Iterable[str]) -> dict[str, Any]:
    """Returns what `plugins.files_at_hand` does of a task, some of whose files were recorded."""
    if not name.startswith(GYM):
        return plugins.files_at_hand(name, installed_tasks())

    files = gym_registry.files_at_hand(recorded)
    return {"sources": files} if files else {}


def episode_provenance(name: str) -> dict[str, Any]:
    """Returns what records of work on a task note if its episodes do not repeat; otherwise {}."""
    return {} if find_task(name).repeats() else {EPISODES_REPEAT: False}


def unknown_task(name: str) -> RequestError:
    """Returns the error for a name that is none of a task."""
    if name.endswith((".xml", ".mjcf")):
        return RequestError(
            f"{name} is a model, and a task also needs rewards; write a function that returns an "
            "environment with this model, and type MODULE:NAME (docs/your-own-robot.md)."
        )

    plugins.refuse_path(name)
    advice = advice_on_module(name, "a function in it that returns an environment")
    if advice:
        return RequestError(f"Unknown task {name!r}; {advice}.")

    close = closest(name, [*TASKS, *installed_tasks(), *SUITE_TASKS])
    if close is None:  # a domain, such as cartpole or HalfCheetah-v5
        domains = {task.removeprefix(SUITE).partition("-")[0]: task for task in SUITE_TASKS[::-1]}
        close = next((task for domain, task in domains.items() if domain in name.lower()), None)

    hint = f"did you mean {close}? Choose" if close else "choose"
    if re.search(r"-v\d+$", name):
        hint = f"did you mean {GYM}{name}? Choose"

    return RequestError(
        f"Unknown task {name!r}; {hint} {', '.join(TASKS)}, a task that jbench tasks lists, or "
        f"MODULE:NAME."
    )


def advice_on_module(name: str, meant: str) -> str:
    """Returns what to type for a module, or for MODULE.NAME as in the ids of runs; "" of others.

    `meant` says what NAME is, in the advice for a module alone.
    """
    module, attribute = _module_and_rest(name.removesuffix(".py"))
    if not module:
        return ""

    advice = f"to use the module {module}, type {module}"
    if attribute.isidentifier():
        return f"{advice}:{attribute}"
    return f"{advice}:NAME, {meant}"


def _module_and_rest(name: str) -> tuple[str, str]:
    """Returns the longest beginning of a dotted name that is a module, and the rest; else ""."""
    module = name
    while module and not plugins.is_module(module):
        module = module.rpartition(".")[0]
    return module, name.removeprefix(module).removeprefix(".") if module else ""


def _suite_task(name: str) -> EnvironmentTask:
    """Returns a task of dm_control's suite."""
    if importlib.util.find_spec("dm_control") is None:
        raise RequestError(
            f"{name} needs dm-control, which pip can't install on Python 3.13 and later (labmaze "
            "has no wheel there); use Python 3.11 or 3.12, or a task of the Jitterbug or Gymnasium."
        )

    from dm_control import suite

    logging.getLogger("absl").setLevel(logging.ERROR)  # of attributes that MuJoCo ignores
    domain, _, task = name.removeprefix(SUITE).partition("-")
    if (domain, task) not in suite.ALL_TASKS or "jitterbug" in domain:
        raise unknown_task(name)

    def make(seed: int) -> Any:
        return suite.load(domain, task, task_kwargs={"random": seed})

    return EnvironmentTask(name, make)


def _made_by(name: str, factory: Any, files: Mapping[str, str]) -> EnvironmentTask:
    """Returns a task whose environments a function of the user makes."""
    if not callable(factory):
        raise RequestError(
            f"{name} is of type {type(factory).__name__}; name a function that returns a "
            "dm_env.Environment or a gymnasium.Env."
        )

    taken = plugins.parameters(factory) or {}
    takes_random = "random" in taken

    def make(seed: int, **more: Any) -> Any:
        return factory(random=seed, **more) if takes_random else factory(**more)

    return EnvironmentTask(
        name,
        make,
        takes_random=takes_random,
        files=files,
        description=plugins.first_line(factory),
        provenance=lambda: plugins.code_provenance("task", name, installed_tasks()),
        draw=partial(make, render_mode=RENDER_MODE) if "render_mode" in taken else None,
    )
