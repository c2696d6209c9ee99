"""Which files are a user's code, and what of them counts."""

import importlib
import re
import sys
from pathlib import Path

import pytest

from jbench import syntax
from jbench.sources import checksum, source_files
from tests.documentation import ROOT

MODULE = '''
"""A task."""
import numpy as np
from helper import GAIN


def reward(x, scale=2):
    """Returns the reward."""
    # Comments don't count.
    return GAIN * x + scale
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of modules that Python finds; those that were imported are forgotten."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]
    importlib.invalidate_caches()


def write(folder, modules):
    """Writes modules by their paths without .py."""
    for name, text in modules.items():
        path = folder / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def read(name):
    """Returns the files of a module as a new process sees them."""
    importlib.invalidate_caches()
    return source_files(name)


@pytest.mark.parametrize(
    ("text", "is_same"),
    [
        (MODULE.replace("Returns the reward.", "Another docstring."), True),
        (MODULE.replace("# Comments don't count.", ""), True),
        (MODULE.replace("GAIN * x + scale", "(GAIN*x) + (\n        scale)"), True),
        (MODULE.replace('"""A task."""', "'''An old task.'''"), True),
        (MODULE.replace("def reward(x, scale=2):", "def reward(x, scale=2) :  # m"), True),
        (MODULE.replace("scale=2", "scale=3"), False),
        (MODULE.replace("scale=2", "scale=2.0"), False),
        (MODULE.replace("+ scale", "- scale"), False),
        (MODULE.replace("def reward", "def rewards"), False),
        (MODULE.replace("x + scale", "scale + x"), False),
        (MODULE + "\nreward = abs\n", False),
    ],
)
def test_syntax_tree_decides_whether_code_has_changed(folder, text, is_same):
    write(folder, {"task": MODULE, "helper": "GAIN = 1"})
    before = read("task")
    write(folder, {"task": text})
    after = read("task")
    assert [*before] == [*after] == ["task.py", "helper.py"]
    assert (before == after) == is_same
    assert (checksum(before) == checksum(after)) == is_same


def test_modules_that_it_imports_are_part_of_it_wherever_they_are_imported(folder):
    write(
        folder,
        {
            "task": "import lab.robots\ndef make():\n    from other import late\n    return late\n",
            "other": "import unknown_module, json, jbench",
            "unused": "",
            "lab/__init__": "from . import shared",
            "lab/shared": "",
            "lab/robots": "from .arms import arm as left\nfrom ..outside import nothing",
            "lab/arms/__init__": "",
            "lab/arms/arm": "",
            "lab/arms/unused": "",
        },
    )
    assert set(read("task")) == {
        "task.py",
        "other.py",
        "lab/__init__.py",
        "lab/shared.py",
        "lab/robots.py",
        "lab/arms/__init__.py",
        "lab/arms/arm.py",
    }
    # That of a package begins with the package.
    assert set(read("lab.arms.arm")) == {
        "lab/arms/arm.py",
        "lab/arms/__init__.py",
        "lab/__init__.py",
        "lab/shared.py",
    }


def test_module_is_read_once_it_is_imported_and_not_imported_to_be_read(folder):
    modules = {"task": "raise ValueError", "lab/__init__": "raise ValueError", "lab/task": "x = 1"}
    write(folder, modules)
    assert [*read("task")] == ["task.py"]
    assert set(read("lab.task")) == {"lab/task.py", "lab/__init__.py"}
    assert "task" not in sys.modules
    write(folder, {"other": "x = 1"})
    importlib.import_module("other")
    imported = read("other")
    write(folder, {"other": "x = 2"})
    assert read("other") == imported  # the process runs what it has imported


@pytest.mark.parametrize(
    "code", ["'x.npy'", "HERE / 'data' / 'x.npy'", "join(HERE, 'data', 'x.npy')"]
)
def test_data_files_that_it_names_count(folder, code):
    write(folder, {"task": f"load({code})"})
    (folder / "data").mkdir()
    name = "x.npy" if code == "'x.npy'" else "data/x.npy"
    (folder / name).write_bytes(b"1")
    before = read("task")
    assert [*before] == ["task.py", name]
    (folder / name).write_bytes(b"2")
    assert read("task") != before


@pytest.mark.parametrize(
    "code",
    ["open('x.json', 'w')", "numpy.save('x.npy', 1)", "path.write_text('x.json')", "load('x.xml')"],
)
def test_files_that_it_writes_or_mujoco_reads_are_left_out(folder, code):
    write(folder, {"task": code})
    for name in ("x.json", "x.npy", "x.xml"):
        (folder / name).write_bytes(b"1")
    assert [*read("task")] == ["task.py"]


@pytest.mark.parametrize(
    "code",
    [
        f"help = '{chr(0x6A21) * 150}.json'",  # longer than a name may be, in bytes
        "load('circle.json')",
        "def later():\n    from " + "." * 99 + " import above",
        f"x = {'+'.join(['1'] * 20_000)}",
    ],
)
def test_code_that_names_no_file_is_still_code(folder, code):
    write(folder, {"task": code})
    (folder / "circle.json").symlink_to("circle.json")
    assert [*read("task")] == ["task.py"]


def test_data_file_that_cannot_be_read_is_left_out(folder, monkeypatch):
    write(folder, {"task": "load('x.npy')"})
    (folder / "x.npy").write_bytes(b"1")
    opened = Path.open

    def refused(path, *arguments, **named):
        if path.suffix == ".npy":
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments, **named)

    monkeypatch.setattr(Path, "open", refused)  # who is root reads all files
    assert [*read("task")] == ["task.py"]


@pytest.mark.parametrize(
    ("code", "file"),
    [
        ("load('x.txt')", "x.txt"),
        ("load(f'x-{number}.npy')", "x-1.npy"),
        ("load('x' + '.npy')", "x.npy"),
        ("FOLDER = HERE / 'data'\nload(FOLDER / 'x.npy')", "data/x.npy"),
    ],
)
def test_documented_data_files_are_not_seen(folder, code, file):
    write(folder, {"task": code})
    (folder / "data").mkdir()
    (folder / file).write_bytes(b"1")
    assert [*read("task")] == ["task.py"]


def test_endings_of_data_files_are_documented():
    page = (ROOT / "docs" / "changed-code.md").read_text()
    (text,) = re.findall(r"These endings are seen: (.*?);", page, re.DOTALL)
    assert set(re.findall(r"`(\..*?)`", text)) == syntax._DATA


@pytest.mark.parametrize("name", ["json", "os.path", "jbench.plugins", "no_such_module", "numpy"])
def test_code_of_python_jbench_and_libraries_is_not_of_a_user(name):
    assert read(name) == {}


def test_installed_package_counts_if_it_is_made_for_jbench_or_from_a_folder(folder, monkeypatch):
    site = folder / "site-packages"
    points = "[jbench.agents]\nours = ours:Agent\n"
    local = '{"url": "file:///home/me/local", "dir_info": {}}'
    for name, file, text in (
        ("ours", "entry_points.txt", points),
        ("local", "direct_url.json", local),
        ("library", "direct_url.json", '{"url": "https://example.org/library.whl"}'),
    ):
        write(site, {f"{name}/__init__": "import beside", f"{name}/part": ""})
        about = site / f"{name}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (about / "RECORD").write_text(f"{name}/__init__.py,,\n{name}/part.py,,\n")
        (about / file).write_text(text)
    write(site, {"beside": ""})
    read("ours")  # before the packages can be imported
    monkeypatch.syspath_prepend(str(site))
    assert [*read("ours")] == ["ours/__init__.py"]  # what is beside it is another package
    assert set(read("local.part")) == {"local/part.py", "local/__init__.py"}
    assert read("library") == {}
