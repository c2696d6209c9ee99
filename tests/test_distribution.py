"""Tests of the sdist and the wheel: their files, and the commands of the installed wheel."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from jbench import __version__
from jbench.names import POLICY_FILES
from jbench.store.rows import has_policy
from jbench.store.shipped import kept_policies, shipped_results
from tests import every_verb
from tests.command_line import SHORT
from tests.short_episodes import statements

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


def packaged():
    """Returns the files of this checkout without the policies that only the repository has."""
    shipped, kept = "jbench/reference/runs/", kept_policies()
    assert 0 < len(kept) <= 10

    def is_left_out(name):
        run, _, file = name.removeprefix(shipped).rpartition("/")
        return name.startswith(shipped) and file in POLICY_FILES and run not in kept

    return {name for name in checkout() if not is_left_out(name)}


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
    """The wheel, built where an earlier version was built before."""
    left = sdist / "build" / "lib" / "jbench" / "module_of_an_earlier_version.py"
    left.parent.mkdir(parents=True)
    left.write_text("")
    return build("wheel", sdist, tmp_path_factory.mktemp("wheel") / "dist")


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A directory outside the checkout with the wheel installed in `packages`."""
    place = tmp_path_factory.mktemp("installed")
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    subprocess.run([*pip, "--target", place / "packages", wheel], check=True)
    return place


@pytest.mark.slow
def test_sdist_contains_every_file_of_checkout(sdist):
    generated = {"PKG-INFO", "setup.cfg", *(name for name in files(sdist) if ".egg-info/" in name)}
    assert files(sdist) - generated == packaged() - generated - {".gitignore"}


@pytest.mark.slow
def test_wheel_contains_only_package(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == {name for name in packaged() if name.startswith("jbench/")}
    for suffix in (".xml", ".csv", ".toml", ".css", ".js", "py.typed", "manifest.json", ".parquet"):
        assert any(name.endswith(suffix) for name in names)


def test_package_that_was_built_from_a_checkout_knows_its_revision(tmp_path):
    (tmp_path / "jbench").mkdir()
    shutil.copy(ROOT / "jbench" / "revision.py", tmp_path / "jbench")
    ask = [sys.executable, "-c", "import revision; print(revision.git_revision())"]
    place = {"cwd": tmp_path / "jbench", "text": True}
    assert subprocess.check_output(ask, **place) == "None\n"
    (tmp_path / "jbench" / "git_revision.txt").write_text("4655a54bd1c2\n")
    assert subprocess.check_output(ask, **place) == "4655a54bd1c2\n"


@pytest.mark.parametrize("tag", [["v0.1.0"], ["-a", "v0.1.0", "-m", "a release"]])
def test_checkout_of_a_release_names_its_commit_and_not_its_tag(tag, tmp_path):
    def git(*typed):
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.check_output(["git", *who, *typed], cwd=tmp_path, text=True).strip()

    (tmp_path / "jbench").mkdir()
    file = shutil.copy(ROOT / "jbench" / "revision.py", tmp_path / "jbench")
    git("init", "--quiet")
    git("add", "jbench/revision.py")
    git("commit", "--quiet", "-m", "first")
    git("tag", *tag)
    ask = [sys.executable, "-B", "-c", "import revision; print(revision.git_revision())"]
    place = {"cwd": tmp_path / "jbench", "text": True}
    commit = git("rev-parse", "HEAD")[:12]
    assert subprocess.check_output(ask, **place) == f"{commit}\n"
    with open(file, "a", encoding="utf-8") as changed:
        changed.write("# changed\n")
    assert subprocess.check_output(ask, **place) == f"{commit}-dirty\n"


@pytest.mark.slow
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="unpacked from an archive")
def test_wheel_of_a_checkout_has_its_revision(tmp_path):
    git = ["git", "clone", "--quiet", "--depth", "1", f"file://{ROOT}", str(tmp_path / "clone")]
    subprocess.run(git, check=True)
    head = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=tmp_path / "clone", text=True)
    with zipfile.ZipFile(build("wheel", tmp_path / "clone", tmp_path / "dist")) as archive:
        recorded = archive.read("jbench/git_revision.txt").decode().strip()
    assert len(recorded) >= 12
    assert head.startswith(recorded)


@pytest.mark.slow
def test_description_has_no_relative_links_or_images(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode())
    description = metadata.get_payload()
    assert metadata["Version"] == __version__
    assert description.startswith("# jbench")
    assert "](docs/" not in description
    assert "![" not in description


def run(installed, *arguments, code=0):
    """Runs Python with the installed package and short episodes; returns its output, or errors."""
    (installed / "sitecustomize.py").write_text(statements(SHORT))
    packages = os.pathsep.join([str(installed), str(installed / "packages")])
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=installed,
        env={**os.environ, "PYTHONPATH": packages},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == code, done.stderr
    return done.stderr if code else done.stdout


@pytest.mark.slow
def test_installed_command_prints_version_and_shipped_runs(installed):
    assert list((installed / "packages" / "bin").glob("jbench*"))
    assert run(installed, "-m", "jbench", "--version") == f"jbench {__version__}\n"
    printed = run(installed, "-m", "jbench", "runs", "--results", "reference")
    assert "face_direction/td3/full/s00-" in printed


def test_lock_has_every_dependency_within_its_bounds():
    """torch is left out: CPU or CUDA is the machine's choice."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    asked += project["optional-dependencies"]["docs"]
    locked = (ROOT / "requirements.lock").read_text()
    pinned = dict(re.findall(r"^(\S+)==(\S+)", locked, re.M))
    for text in asked:
        requirement = Requirement(text)
        name = canonicalize_name(requirement.name)
        if name not in ("jbench", "torch"):
            assert requirement.specifier.contains(pinned[name]), text
    assert "torch" not in pinned
    assert locked.count("--hash=sha256:") > len(pinned)


@pytest.mark.slow
def test_wheel_is_small_and_has_the_kept_policies(wheel):
    assert wheel.stat().st_size < 12_000_000
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    with_policy = {
        name.removeprefix("jbench/reference/runs/").rpartition("/")[0]
        for name in names
        if name.endswith("/policy.safetensors")
    }
    assert with_policy == kept_policies()


def test_kept_policies_are_those_that_documents_show():
    """A policy that a document names is in the wheel, so its command runs there, too."""
    documents = [ROOT / "README.md", *ROOT.glob("docs/*.md"), ROOT / "docs/images/gallery.py"]
    text = "".join(document.read_text() for document in documents)
    named = set(
        re.findall(r"reference/([a-z_]+/[a-z0-9]+/[a-z0-9-]+(?:/s[0-9]+(?:-[0-9a-f]+)?)?)", text)
    )
    assert len(named) > 3
    for beginning in named:
        assert any(policy.startswith(beginning) for policy in kept_policies()), beginning


TABLES = ("runs", "episodes", "evaluations", "encoders", "encoder_epochs", "policy_episodes")
EVERY_ROW = " UNION ALL ".join(
    f"SELECT count(*) AS rows, bit_xor(hash(one))::VARCHAR AS values FROM {table} AS one"
    for table in TABLES
)
"""A query whose result does not depend on the order of rows."""


@pytest.mark.slow
def test_installed_results_are_those_of_the_checkout(installed):
    asked = ("-m", "jbench", "query", EVERY_ROW, "--results", "reference", "--json")
    assert json.loads(run(installed, *asked)) == json.loads(
        subprocess.run(
            [sys.executable, *asked], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
    )
    printed = run(installed, "-m", "jbench", "verify", "--results", "reference")
    policies = [run for run in shipped_results().scan("run")[0] if has_policy(run)]
    left_out = len(policies) - len(kept_policies())
    assert f"Not checked: the policy of {left_out} runs, which is left out of" in printed
    assert "all of them intact" in printed
    chosen = ("--task", "face_direction", "--algo", "sac", "--format", "svg")
    run(installed, "-m", "jbench", "report", "--results", "reference", *chosen)
    assert (installed / "reference-report" / "index.html").exists()


@pytest.mark.slow
def test_left_out_policy_is_refused_in_a_sentence(installed):
    """The run is there, with all of its rows; a checkout has the policy."""
    name = "reference/face_direction/ppo/full/s00"
    arguments = ("-m", "jbench", "evaluate", name, "--episodes", "1")
    error = run(installed, *arguments, code=2)
    assert f"Error: The policy of {name} is left out of the installed package" in error
    assert "results/reference" in error


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


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere, PyTorch has no build with CUDA")
@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
@pytest.mark.parametrize(("driver", "is_for_cpu"), [("", True), ("/dev/nvidiactl", False)])
def test_make_installs_pytorch_for_the_cpu_where_there_is_no_nvidia_driver(driver, is_for_cpu):
    plan = ["make", "--dry-run", "--always-make", "install", f"DRIVER={driver}"]
    planned = subprocess.check_output(plan, cwd=ROOT, text=True)
    (torch,) = (line for line in planned.splitlines() if "torch==" in line)
    assert ("download.pytorch.org/whl/cpu" in torch) == is_for_cpu
