"""Which robot it is, only tasks and settings ask, and which engine, the choice of a trainer.

Everything else asks the task, or the facts of the engine.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

JBENCH = Path(__file__).parents[2] / "jbench"
MAY_ASK = ("tasks/", "settings/", "task_specs.py", "datasets/by_robot.py")
KNOW_THE_JITTERBUG = {
    "checks/machine.py",  # measures a physics step of it
    "datasets/jitterbug.py",
    "encoders/kinds/planar.py",  # its mechanics are known to these encoders
}

MAKE_AN_AGENT = {
    "studies/arms.py",  # finds recorded runs without torch
    "training/continuation.py",  # asks the class of an agent whether it can be resumed
    "training/engines.py",
    "training/request.py",  # tries the settings of a class of stable-baselines3
}


def last_name(node):
    """Returns the last name of an expression, such as specs of run.specs."""
    return getattr(node, "attr", getattr(node, "id", None))


def is_question(node):
    """Returns whether a comparison is such as `task in TASKS` or `robot == JITTERBUG`."""
    if not isinstance(node, ast.Compare):
        return False
    (right,) = node.comparators[:1]
    if isinstance(node.ops[0], ast.In | ast.NotIn):
        return last_name(right) in ("TASKS", "TASK_SPECS")
    if last_name(right) == "JITTERBUG":
        return True
    is_none = isinstance(right, ast.Constant) and right.value is None
    return is_none and last_name(node.left) == "specs"


def questions(nodes):
    return [node.lineno for node in nodes if is_question(node)]


@cache
def modules():
    """Returns all nodes of each module by its file."""
    return {
        path.relative_to(JBENCH).as_posix(): [*ast.walk(ast.parse(path.read_text()))]
        for path in JBENCH.rglob("*.py")
    }


@pytest.mark.parametrize(
    "question",
    [
        "task in TASKS",
        "run.task not in names.TASKS",
        "run.specs is not None",
        "dataset.robot != JITTERBUG",
    ],
)
def test_question_is_found(question):
    assert questions(ast.walk(ast.parse(f"if {question}:\n    pass"))) == [1]
    assert questions(ast.walk(ast.parse("for task in TASKS:\n    pass"))) == []


def test_only_tasks_and_settings_ask_which_robot_it_is():
    found = {
        name: lines
        for name, nodes in modules().items()
        if not name.startswith(MAY_ASK) and (lines := questions(nodes))
    }
    assert found == {}


def test_few_files_know_the_jitterbug():
    found = {
        name
        for name, nodes in modules().items()
        if not name.startswith("tasks/") and "jbench.tasks.jitterbug" in imported(nodes)
    }
    assert found == KNOW_THE_JITTERBUG


def asks_for_engine(node):
    """Returns whether a comparison is such as `run.engine == "sb3"`."""
    if not isinstance(node, ast.Compare) or last_name(node.left) != "engine":
        return False
    return isinstance(getattr(node.comparators[0], "value", None), str)


def test_few_files_ask_which_engine_it_is():
    found = {
        name
        for name, nodes in modules().items()
        if not name.startswith("settings/") and any(map(asks_for_engine, nodes))
    }
    assert found == MAKE_AN_AGENT


def imported(nodes):
    """Returns the packages of the modules that a file imports from."""
    names = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    return {".".join(name.split(".")[:3]) for name in names if name}
