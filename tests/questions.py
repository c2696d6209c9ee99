"""Checks who asks for the robot or the engine: `python tests/questions.py`, by `make lint`.

Which robot it is, only tasks and settings ask; everything else asks the task. Which engine it is,
nothing asks: `jbench/settings/engines.py` has the facts of each.
"""

import ast
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

from jbench.names import EngineName

JBENCH = Path(__file__).resolve().parents[1] / "jbench"
MAY_ASK = ("tasks/", "settings/", "task_specs.py", "datasets/by_robot.py")
KNOW_THE_JITTERBUG = {
    "checks/machine.py",  # measures a physics step of it
    "datasets/jitterbug.py",
    "encoders/kinds/planar.py",  # its mechanics are known to these encoders
}

ENGINES = get_args(EngineName)

Modules = dict[str, list[ast.AST]]
"""All nodes of each module by its file."""


def last_name(node: ast.AST) -> str | None:
    """Returns the last name of an expression, such as specs of run.specs."""
    return getattr(node, "attr", getattr(node, "id", None))


def asks_for_robot(node: ast.AST) -> bool:
    """Returns whether a comparison is such as `task in TASKS` or `robot == JITTERBUG`."""
    if not isinstance(node, ast.Compare):
        return False

    right = node.comparators[0]
    if isinstance(node.ops[0], ast.In | ast.NotIn):
        return last_name(right) in ("TASKS", "TASK_SPECS")
    if last_name(right) == "JITTERBUG":
        return True
    is_none = isinstance(right, ast.Constant) and right.value is None
    return is_none and last_name(node.left) == "specs"


def asks_for_engine(node: ast.AST) -> bool:
    """Returns whether a comparison is such as `run.engine == "sb3"`."""
    if not isinstance(node, ast.Compare):
        return False
    compared = (getattr(part, "value", None) for part in ast.walk(node))
    return any(value in ENGINES for value in compared if isinstance(value, str))


def imports_jitterbug(node: ast.AST) -> bool:
    """Returns whether a statement imports from the package of the Jitterbug."""
    package = "jbench.tasks.jitterbug"
    return isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith(f"{package}.")


def modules() -> Modules:
    """Returns the modules of jbench."""
    return {
        path.relative_to(JBENCH).as_posix(): [*ast.walk(ast.parse(path.read_text("utf-8")))]
        for path in sorted(JBENCH.rglob("*.py"))
    }


def files_with(is_found: Callable[[ast.AST], bool], found_in: Modules) -> set[str]:
    """Returns the files that have a node of a sort."""
    return {name for name, nodes in found_in.items() if any(map(is_found, nodes))}


def mistakes(found_in: Modules) -> Iterator[str]:
    """Yields a sentence for each file that asks and must not, or that no longer asks."""
    robot = {name for name in files_with(asks_for_robot, found_in) if name.startswith(MAY_ASK)}
    if not robot:
        yield "No question for the robot is found in tasks and settings: this check is blind."
    for name in sorted(files_with(asks_for_robot, found_in) - robot):
        yield f"{name} asks which robot it is; ask the task."

    know = {
        name for name in files_with(imports_jitterbug, found_in) if not name.startswith("tasks/")
    }
    for name in sorted(know - KNOW_THE_JITTERBUG):
        yield f"{name} imports from jbench.tasks.jitterbug; ask the task, or list it here."
    for name in sorted(KNOW_THE_JITTERBUG - know):
        yield f"{name} is listed here, and no longer imports from jbench.tasks.jitterbug."

    for name in sorted(files_with(asks_for_engine, found_in)):
        yield f"{name} asks which engine it is; ask the facts of the engine."


if __name__ == "__main__":
    sys.exit("\n".join(mistakes(modules())) or None)
