"""Tests that no module of jbench uses pickle, eval or a shell, by a scan of its syntax trees."""

import ast
from pathlib import Path

import pytest

import jbench

SOURCES = sorted(Path(jbench.__file__).parent.rglob("*.py"))

MODULES = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
BARE = {"eval", "exec", "compile", "__import__"}
METHODS = {
    "load": {"torch", "yaml", "joblib", "marshal", "pickle"},
    "unsafe_load": {"yaml"},
    "full_load": {"yaml"},
    "save": {"torch"},
    "system": {"os"},
    "popen": {"os"},
}
ANYWHERE = {"read_pickle", "to_pickle", "load_pickle", "save_pickle"}
KEYWORDS = {"shell", "allow_pickle"}


def offences(tree):
    """Yields the uses of functions that could execute untrusted code, with their line numbers."""
    weights_only = {
        node.func
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and any(
            keyword.arg == "weights_only"
            and isinstance(keyword.value, ast.Constant)
            and keyword.value.value is True
            for keyword in node.keywords
        )
    }
    for node in ast.walk(tree):
        if node in weights_only:  # torch.load that refuses all objects but tensors
            continue
        if isinstance(node, ast.Import):
            named = {alias.name.split(".")[0] for alias in node.names}
            yield from ((node.lineno, name) for name in named & MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported = {alias.name for alias in node.names}
            package = node.module.split(".")[0]
            if package in MODULES:
                yield node.lineno, package
            for name in imported & METHODS.keys():
                if package in METHODS[name]:
                    yield node.lineno, f"{package}.{name}"
        elif isinstance(node, ast.Name) and node.id in BARE:
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else None
            if node.attr in ANYWHERE or owner in METHODS.get(node.attr, ()):
                yield node.lineno, f"{owner}.{node.attr}"
        elif isinstance(node, ast.keyword) and node.arg in KEYWORDS:
            denied = isinstance(node.value, ast.Constant) and node.value.value is False
            yield from () if denied else ((node.lineno, f"{node.arg}="),)


def test_scan_finds_modules_of_package():
    assert len(SOURCES) > 50


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_module_uses_no_pickle_eval_or_shell(path):
    assert list(offences(ast.parse(path.read_text()))) == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "import os, pickle as p",
        "from pickle import loads",
        "import torch.multiprocessing, joblib.memory",
        "from torch import load",
        "eval(text)",
        "run = exec",
        "torch.load(path)",
        "torch.load(path, weights_only=weights)",
        "yaml.load(text)",
        "os.system('ls')",
        "subprocess.run('ls', shell=True)",
        "subprocess.run('ls', shell=expected)",
        "numpy.load(path, allow_pickle=True)",
        "pandas.read_pickle(path)",
        "frame.to_pickle(path)",
    ],
)
def test_scan_reports_unsafe_line(line):
    assert list(offences(ast.parse(line)))


@pytest.mark.parametrize(
    "line",
    [
        "model.eval()",
        "re.compile('x')",
        "json.load(file)",
        "numpy.load(path, allow_pickle=False)",
        "torch.load(path, weights_only=True)",
    ],
)
def test_scan_permits_safe_line(line):
    assert not list(offences(ast.parse(line)))
