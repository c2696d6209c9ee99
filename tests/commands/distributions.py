"""Installs third-party packages by pip without a network, and trains their agents."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from jbench.cli import main
from jbench.store import Results
from jbench.training.batched_run import run_batch
from tests.command_line import SHORT, succeed
from tests.documentation import ROOT, code_of


def install(name, page, module, tmp_path_factory):
    """Installs a distribution whose code is on a page of docs/; returns the folder of packages.

    Args:
        name: folder in tests/ with the other files of the distribution.
        page: name of the page; its first Python block becomes a module, and its TOML block must be
            part of the distribution's pyproject.toml.
        module: name of the module's file.
    """
    source = tmp_path_factory.mktemp("source") / name
    shutil.copytree(ROOT / "tests" / name, source)
    # The distribution may have more modules and entry points than the page.
    others = "".join(f', "{path.stem}"' for path in source.glob("*.py"))
    shown = code_of(page, "toml").replace('"]\n\n[project.entry', f'"{others}]\n\n[project.entry')
    assert shown in (source / "pyproject.toml").read_text()
    (source / module).write_text(code_of(page, "python"))
    target = tmp_path_factory.mktemp("site")
    options = ("--no-index", "--no-build-isolation", "--no-deps", "--target", str(target))
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", *options, str(source)], check=True
    )
    return target


def make_importable(site, patch):
    """Makes the packages of a folder importable in this process and its child processes."""
    patch.syspath_prepend(str(site))
    patch.setenv("PYTHONPATH", os.pathsep.join([str(site), str(ROOT)]))


def train_and_sweep(site, directory, train, matrix):
    """Returns results of a sweep, the first seed of which `jbench train` has trained.

    Args:
        site: folder of packages.
        directory: where the matrix and the results are written.
        train: arguments of `jbench train`.
        matrix: text of the matrix; its runs have one short episode.
    """
    results = directory / "results"
    (directory / "matrix.toml").write_text(matrix)
    with pytest.MonkeyPatch.context() as patch:
        make_importable(site, patch)
        first = ("--seeds", "0", "--steps", str(SHORT))
        succeed("train", *train, *first, results=results, short=True)
        succeed("sweep", directory / "matrix.toml", results=results, short=True)
    return Results(results)


def assert_listed_reported_and_verified(results, algo, capsys):
    """Checks the two runs of `train_and_sweep` by commands of a process without the package."""
    here = ("--results", str(results.path))
    assert main(["runs", "--algo", algo, *here]) == 0
    assert f"face_direction/{algo}/full/s00-" in capsys.readouterr().out
    assert main(["verify", *here]) == 0
    report = ("report", "--json", "--format", "png", "--out", results.path / "out")
    rows = json.loads(succeed(*report, results=results.path, short=True).stdout)["configurations"]
    assert {(row["algo"], row["seeds"]) for row in rows} == {(algo, 2)}


def assert_fails(run, path, sentence, episodes):
    """Trains a run and checks its error message, status and number of committed episodes."""
    results = Results(path)
    try:
        reason = str(run_batch([run], results, checkpoint_every=0)[run.id])
    except (RuntimeError, ValueError) as error:
        reason = str(error)
    assert sentence in reason
    record = results.find("run", run.id)
    assert record.status == "failed"
    assert sentence in record.manifest.summary["error"]
    assert record.rows("episodes") == episodes
