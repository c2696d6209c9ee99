"""Installs third-party packages as pip does, without its processes."""

import json
import os
import shutil
import zipfile
from pathlib import Path

from tests.command_line import Process
from tests.documentation import ROOT, code_of


def install(name, page, module, tmp_path_factory, target=None, part=""):
    """Installs a distribution whose code is on a page of docs/; returns the folder of packages.

    Args:
        name: folder in tests/ with the other files of the distribution.
        page: name of the page; a Python block becomes a module, and its TOML block must be part of
            the distribution's pyproject.toml.
        module: name of the module's file.
        target: folder of packages; None for a new one.
        part: text of the Python block; by default it is the first one.
    """
    source = tmp_path_factory.mktemp("source") / name
    shutil.copytree(ROOT / "tests" / name, source)
    # The distribution may have more modules and entry points than the page.
    others = "".join(f', "{path.stem}"' for path in source.glob("*.py"))
    shown = code_of(page, "toml").replace('"]\n\n[project.entry', f'"{others}]\n\n[project.entry')
    assert shown in (source / "pyproject.toml").read_text()
    (source / module).write_text(code_of(page, "python", part))
    target = target or tmp_path_factory.mktemp("site")
    build = Process("tests.commands.distributions:build", str(source), str(target))
    done = build.finished()
    assert done.returncode == 0, done.stderr
    return target


def build(source, target):
    """Builds the wheel of a distribution, and unpacks it into a folder of packages."""
    from setuptools import build_meta

    os.chdir(source)
    name = build_meta.build_wheel(".")
    with zipfile.ZipFile(name) as wheel:
        wheel.extractall(target)
    project, version, *_ = name.split("-")
    came_from = {"dir_info": {}, "url": Path(source).as_uri()}
    about = Path(target) / f"{project}-{version}.dist-info"
    (about / "direct_url.json").write_text(json.dumps(came_from))
    return 0


def make_importable(site, patch):
    """Makes the packages of a folder importable in this process and its child processes."""
    patch.syspath_prepend(str(site))
    patch.setenv("PYTHONPATH", os.pathsep.join([str(site), str(ROOT)]))
