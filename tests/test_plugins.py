"""Tests of entry points of other packages, and of attributes imported by name."""

import re

import pytest

from jbench import plugins
from jbench.errors import RequestError, WorkError

GROUP = "jbench.tried"


def add_package(path, package, *lines):
    """Writes the metadata of an installed package with entry points."""
    folder = path / f"{package}-1.5.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.5\n")
    text = "\n".join((f"[{GROUP}]", *lines))
    (folder / "entry_points.txt").write_text(text)


def test_entry_points_with_valid_names_are_listed(tmp_path, monkeypatch):
    add_package(tmp_path, "one", "good = math:cos", "Bad = math:sin", "taken = math:tan")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = plugins.offered(GROUP, re.compile("[a-z]+"), {"taken"})
    assert [*found] == ["good"]
    assert plugins.load("function", found["good"])(0) == 1
    assert plugins.made_with(plugins.distribution(found["good"])) == {"package": "one 1.5"}


def test_name_of_two_packages_is_refused(tmp_path, monkeypatch):
    add_package(tmp_path, "one", "good = math:cos")
    add_package(tmp_path, "two", "good = math:sin")
    monkeypatch.syspath_prepend(str(tmp_path))
    point = plugins.offered(GROUP, re.compile("[a-z]+"), ())["good"]
    with pytest.raises(WorkError, match="The function good is offered by one and two; uninstall"):
        plugins.load("function", point)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("lab/robots.py:walker", "type lab.robots:walker."),
        ("./robots.py:walker", "type robots:walker."),
        ("lab/__init__.py:walker", "type lab:walker."),
        (
            "../lab/robots.py:walker",
            "type robots:walker in the directory ../lab, or with it in PYTHONPATH.",
        ),
        (
            "/srv/my-lab/robots.py:walker",
            "type robots:walker in the directory /srv/my-lab, or with it in PYTHONPATH.",
        ),
    ],
)
def test_path_of_a_file_is_refused_with_the_name_of_its_module(name, meant):
    with pytest.raises(RequestError) as caught:
        plugins.refuse_path(name)
    assert str(caught.value) == f"{name} has the path of a file; {meant}"


def test_module_in_working_directory_is_imported(tmp_path, monkeypatch):
    (tmp_path / "beside_me.py").write_text("answer = 42\n")
    (tmp_path / "raising.py").write_text("import math\nmath.sqrt(-1)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [path for path in plugins.sys.path if path])
    assert plugins.imported("number", "beside_me:answer") == 42
    with pytest.raises(RequestError, match=r"has no question; use a name that is in it"):
        plugins.imported("number", "beside_me:question")
    with pytest.raises(RequestError, match=r"has no anser; did you mean beside_me:answer\?"):
        plugins.imported("number", "beside_me:anser")
    with pytest.raises(RequestError, match=r"path of a file; type beside_me:answer\."):
        plugins.imported("number", "beside_me.py:answer")
    elsewhere = "no module beside_you; install its package, or run jbench in the directory that"
    with pytest.raises(RequestError, match=elsewhere):
        plugins.imported("number", "beside_you:answer")
    # The last line of the user's own file, and no package to uninstall.
    loaded = r"x can't be loaded \(ValueError: .*, line 2 of raising\.py\); fix it\.$"
    with pytest.raises(WorkError, match=loaded):
        plugins.imported("number", "raising:x")


def test_module_that_ends_the_process_is_refused_in_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "module_that_exits.py").write_text("import sys\n\nsys.exit(0)\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WorkError, match=r"\(SystemExit: 0, line 3 of module_that_exits\.py\)"):
        plugins.imported("policy", "module_that_exits:act")


def test_package_that_raises_is_named_and_not_looked_for(tmp_path, monkeypatch):
    for package, line in (("raising_package", "1 / 0"), ("lacking_package", "import numppy")):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text(f"{line}\n")
        (tmp_path / package / "inside.py").write_text("answer = 42\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(WorkError, match=r"can't be loaded \(ZeroDivisionError: .*, line 1 of"):
        plugins.imported("number", "raising_package.inside:answer")
    with pytest.raises(WorkError, match=r"No module named 'numppy', line 1 of __init__\.py"):
        plugins.imported("number", "lacking_package.inside:answer")
    with pytest.raises(RequestError, match=r"there is no module json\.insides; install its"):
        plugins.imported("number", "json.insides:answer")
    assert not plugins.is_module("no_such_module")
    assert plugins.is_module("__main__")  # which was not found, but run
