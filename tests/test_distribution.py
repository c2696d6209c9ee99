"""Tests of the sdist and the wheel: their files, and the commands of the installed wheel."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from jbench import __version__
from tests import every_verb
from tests.command_line import SHORT

ROOT = Path(__file__).parents[1]
BUILD = (
    "import sys; from setuptools import build_meta; getattr(build_meta, sys.argv[1])(sys.argv[2])"
)


def checkout():
    """Returns the files of this checkout, or of an unpacked sdist, that git does not ignore."""
    if not (ROOT / ".git").exists():
        return files(ROOT)
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {name for name in listed.splitlines() if (ROOT / name).is_file()}


def files(place):
    return {path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file()}


def build(kind, source, to):
    to.mkdir()
    command = [sys.executable, "-c", BUILD, f"build_{kind}", str(to)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    (built,) = to.iterdir()
    return built


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    place = tmp_path_factory.mktemp("sdist")
    source = place / "checkout"
    for name in checkout():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    with tarfile.open(build("sdist", source, place / "dist")) as archive:
        # Python before 3.11.4 has no filters.
        archive.extraction_filter = getattr(tarfile, "data_filter", None)
        archive.extractall(place)
    return next(place.glob("jbench-*"))


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    return build("wheel", sdist, tmp_path_factory.mktemp("wheel") / "dist")


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A directory outside the checkout with the wheel installed in `packages`."""
    place = tmp_path_factory.mktemp("installed")
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    subprocess.run([*pip, "--target", place / "packages", wheel], check=True)
    return place


def test_sdist_contains_every_file_of_checkout(sdist):
    generated = {"PKG-INFO", "setup.cfg", *(name for name in files(sdist) if ".egg-info/" in name)}
    assert files(sdist) - generated == checkout() - generated - {".gitignore"}


def test_wheel_contains_only_package(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == {name for name in checkout() if name.startswith("jbench/")}
    for suffix in (".xml", ".csv", ".toml", ".css", ".js", "py.typed", "manifest.json", ".parquet"):
        assert any(name.endswith(suffix) for name in names)


def test_description_has_no_relative_links_or_images(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        description = Parser().parsestr(archive.read(name).decode()).get_payload()
    assert description.startswith("# jbench")
    assert "](docs/" not in description
    assert "![" not in description


def run(installed, *arguments):
    """Runs Python with the installed package and short episodes; returns its output."""
    (installed / "sitecustomize.py").write_text(
        f"import jbench.names\njbench.names.EPISODE_STEPS = {SHORT}\n"
    )
    packages = os.pathsep.join([str(installed), str(installed / "packages")])
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=installed,
        env={**os.environ, "PYTHONPATH": packages},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_installed_command_prints_version_and_shipped_runs(installed):
    assert list((installed / "packages" / "bin").glob("jbench*"))
    assert run(installed, "-m", "jbench", "--version") == f"jbench {__version__}\n"
    printed = run(installed, "-m", "jbench", "runs", "--results", "reference")
    assert "face_direction/td3/full/s00-" in printed


@pytest.mark.slow
def test_installed_package_runs_every_command(installed):
    program = ("-c", every_verb.PROGRAM, every_verb.command_lines(installed))
    ended = dict(zip(every_verb.PRINTED, json.loads(run(installed, *program)), strict=True))
    for verb in every_verb.PRINTED.keys() - every_verb.missing():
        code, printed = ended[verb]
        assert code == 0, verb
        assert every_verb.PRINTED[verb] in printed
    (manifest,) = installed.glob("results/runs/face_direction/td3/**/manifest.json")
    # The checkout's revision is not recorded: the installed package made the run.
    assert json.loads(manifest.read_text())["provenance"]["git_revision"] is None
