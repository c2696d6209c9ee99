"""Distributions of other packages, installed by pip without a network."""

import os
import shutil
import subprocess
import sys

from tests.documentation import ROOT, code_of


def install(name, page, module, tmp_path_factory):
    """Returns a folder of packages with a distribution whose code a page of docs/ gives.

    Args:
        name: folder in tests/ with the other files of the distribution.
        page: name of the page; its first Python block becomes a module, and its TOML block must be
            part of the distribution's pyproject.toml.
        module: name of the module's file.
    """
    source = tmp_path_factory.mktemp("source") / name
    shutil.copytree(ROOT / "tests" / name, source)
    assert code_of(page, "toml") in (source / "pyproject.toml").read_text()
    (source / module).write_text(code_of(page, "python"))
    target = tmp_path_factory.mktemp("site")
    options = ("--no-index", "--no-build-isolation", "--no-deps", "--target", str(target))
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", *options, str(source)], check=True
    )
    return target


def use(site, patch):
    """Makes the packages of a folder importable here and in processes that are started."""
    patch.syspath_prepend(str(site))
    patch.setenv("PYTHONPATH", os.pathsep.join([str(site), str(ROOT)]))
