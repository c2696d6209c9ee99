"""Tests of jbench without Linux-only modules and without dm_control.

Modules and functions that Windows and macOS lack are removed before jbench is imported;
portalocker, which has code for each system, is imported before.
"""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from jbench.cli import app
from jbench.errors import WorkError
from jbench.store import Results
from tests import every_verb
from tests.command_line import SHORT
from tests.short_episodes import statements

# Source of a sitecustomize module, which Python imports at the start. Episodes are short.
WITHOUT_LINUX = f"""
import os, signal, sys
import portalocker
for module in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules[module] = None
for flag in ("O_NOFOLLOW", "O_NONBLOCK"):
    delattr(os, flag)
for call in ("posix_fallocate", "sched_getaffinity"):
    delattr(os, call)
del signal.pthread_sigmask
{statements(SHORT)}"""

WITHOUT_DM_CONTROL = """
import importlib.metadata, sys
sys.modules["dm_control"] = sys.modules["labmaze"] = None
find = importlib.metadata.version
def version(name):
    if name == "dm-control":
        raise importlib.metadata.PackageNotFoundError(name)
    return find(name)
importlib.metadata.version = version
"""


def customize(place, source):
    """Returns the environment of Python processes that first import a module."""
    (place / "sitecustomize.py").write_text(source)
    paths = [str(place), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def answer(program, *arguments, env):
    """Runs a program; returns its output, and what it wrote to standard error."""
    command = [sys.executable, "-c", program, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def without_linux(tmp_path_factory):
    """The exit code and the output of each command."""
    place = tmp_path_factory.mktemp("elsewhere")
    typed = (every_verb.PROGRAM, every_verb.command_lines(place))
    printed, _ = answer(*typed, env=customize(place, WITHOUT_LINUX))
    return dict(zip(every_verb.PRINTED, json.loads(printed), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("verb", every_verb.PRINTED)
def test_commands_work_without_linux_only_modules(verb, without_linux):
    code, printed = without_linux[verb]
    assert code == 0
    assert every_verb.PRINTED[verb] in printed


def names_an_encoding(call, arguments_before):
    """Returns whether a call has more positional arguments than these, or one called encoding."""
    is_named = any(keyword.arg == "encoding" for keyword in call.keywords)
    return is_named or len(call.args) > arguments_before


def test_texts_are_read_and_written_in_a_named_encoding():
    # That of Windows is not UTF-8, and names of users' files, tasks and settings need not be ASCII.
    root = Path(__file__).parents[1]
    files = [root / "setup.py", *root.glob("jbench/**/*.py"), *root.glob("benchmarks/*.py")]
    calls = [
        (file, node)
        for file in files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]
    arguments_before = {"read_text": 0, "write_text": 1}
    found = [call for call in calls if call[1].func.attr in arguments_before]
    assert len(found) > 10
    assert [
        f"{file.name}:{call.lineno}"
        for file, call in found
        if not names_an_encoding(call, arguments_before[call.func.attr])
    ] == []


def test_every_command_is_covered():
    shown = {name for name, verb in get_command(app).commands.items() if not verb.hidden}
    assert {*every_verb.PRINTED, *every_verb.TESTED_ELSEWHERE} == shown


RUN = "face_direction/td3/full/s00-00000000"
HELD = f"""
import sys
from pathlib import Path
from jbench.store import Results
with Results(Path(sys.argv[1])).folder("run", "{RUN}").lock():
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_lock_without_fcntl_is_released_when_holder_is_killed(tmp_path):
    folder = Results(tmp_path / "results").folder("run", RUN)
    command = [sys.executable, "-c", HELD, str(tmp_path / "results")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    env = customize(tmp_path, WITHOUT_LINUX)
    with subprocess.Popen(command, env=env, **pipes) as holder:
        assert holder.stdout.readline() == b"locked\n"
        with pytest.raises(WorkError, match="Another process is writing"):
            folder.lock().__enter__()
        holder.kill()
        holder.wait()
        with folder.lock():
            pass


WITHOUT_THE_DOMAIN = """
import sys
import gymnasium, jbench
env = gymnasium.make("Jitterbug/FaceDirection-v0")
print(env.reset(seed=0)[0].shape)
from jbench.tasks.jitterbug.robots import load_model
print(load_model(3).nv)
from jbench.store.provenance import process_provenance
packages = process_provenance()["packages"]
print("dm-control" in packages, "mujoco" in packages)
try:
    import jbench.tasks.jitterbug.domain
except ImportError as error:
    print(error)
from jbench.cli import main
sys.exit(main(["collect", "--steps", "1000", "--results", sys.argv[1]]))
"""


@pytest.mark.slow
def test_without_dm_control_only_its_domain_is_refused(tmp_path):
    program = (WITHOUT_THE_DOMAIN, tmp_path / "results")
    printed, _ = answer(*program, env=customize(tmp_path, WITHOUT_DM_CONTROL))
    lines = printed.splitlines()
    assert lines[:4] == [
        "(16,)",
        "15",
        "False True",
        "The dm_control domains need dm-control, which pip can't install on Python 3.13 and later "
        "(labmaze has no wheel there); use Python 3.11 or 3.12, or the Gymnasium environments.",
    ]
    assert lines[4].startswith("Dataset random/s00-")


DOMAIN = """
from dm_control import suite
print(suite.load("jitterbug", "move_to_pose").action_spec().shape)
"""


@pytest.mark.slow
def test_tasks_need_no_labmaze_and_warn_of_no_display(tmp_path):
    env = customize(tmp_path, "import sys\nsys.modules['labmaze'] = None\n")
    assert answer(f"import jbench.tasks{DOMAIN}", env=env)[0] == "(1,)\n"
    env |= dict.fromkeys(("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"), "")
    assert answer("import jbench.tasks", env=env) == ("", "")
