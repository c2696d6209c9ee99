"""Tests of the choice of the OpenGL backend, and of its error messages."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from jbench import opengl
from jbench.errors import RequestError
from jbench.opengl import choose_backend

ROOT = Path(__file__).parents[1]
DRAW = """
import gymnasium, os
env = gymnasium.make("jbench.tasks:Jitterbug/FaceDirection-v0", render_mode="rgb_array")
env.reset(seed=0)
print(env.render().std() > 10, os.environ["MUJOCO_GL"])
env.close()
"""

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems have other backends")


# `tasks/test_environment_tasks.py` draws this robot and others without a setting.
@pytest.mark.slow
@on_linux
@pytest.mark.usefixtures("rendering")
@pytest.mark.parametrize("switched_off", [{}, {"MUJOCO_GL": "disable"}])
def test_environment_renders_without_display_or_setting(switched_off):
    unset = {*_DISPLAYS, "MUJOCO_GL", "PYOPENGL_PLATFORM"}
    kept = {name: value for name, value in os.environ.items() if name not in unset}
    command = [sys.executable, "-W", "ignore", "-c", DRAW]
    printed = subprocess.check_output(command, env={**kept, **switched_off}, text=True)
    drawn, variable = printed.split()
    assert drawn == "True"
    assert variable in ("egl", "osmesa")


@pytest.fixture
def fake_machine(monkeypatch):
    """Returns a function that fakes the working backends and the display of a machine."""

    def fake(works, mujoco_gl="", display=""):
        tried = []
        for name in ("PYOPENGL_PLATFORM", *_DISPLAYS):
            monkeypatch.setenv(name, "")
        monkeypatch.setenv("MUJOCO_GL", mujoco_gl)
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.setattr(opengl, "draws", lambda name: (tried.append(name), name in works)[1])
        return tried

    return fake


@on_linux
@pytest.mark.parametrize(
    ("mujoco_gl", "says"),
    [
        ("", r"can draw pictures \(tried egl, osmesa\): type apt .* libosmesa6 .* conda-forge"),
        ("EGL", "^MUJOCO_GL=egl can't draw here; unset it to use a working backend.$"),
        ("vulkan", "^MUJOCO_GL=vulkan is not a backend; set it to glfw"),
    ],
)
def test_failing_backends_are_refused(fake_machine, mujoco_gl, says):
    fake_machine(works=(), mujoco_gl=mujoco_gl)
    with pytest.raises(RequestError, match=says):
        choose_backend()


ALL = ("glfw", "egl", "osmesa")


@on_linux
@pytest.mark.parametrize(
    ("works", "mujoco_gl", "display", "tried"),
    [
        (ALL, "", ":0", ["glfw"]),
        (ALL, "", "", ["egl"]),
        (("osmesa",), "", ":0", ["glfw", "egl", "osmesa"]),
        # MuJoCo reads it in the same way.
        (ALL, "glfw", "", ["glfw"]),
        (ALL, " OSMesa ", "", ["osmesa"]),
        (ALL, "on", "", ["glfw"]),
    ],
)
def test_first_working_backend_is_used(fake_machine, works, mujoco_gl, display, tried):
    attempts = fake_machine(works, mujoco_gl, display)
    assert choose_backend() == tried[-1] == os.environ["MUJOCO_GL"]
    assert attempts == tried


@pytest.mark.parametrize(
    ("probe", "draws"),
    [
        ("print('brightness', 173)", True),
        ("print('brightness', 173, flush=True); import os; os.abort()", True),  # while unloading
        ("print('brightness', 0)", False),
        ("import os; os.abort()", False),
        ("raise ImportError", False),
        pytest.param("import time; time.sleep(600)", False, marks=pytest.mark.slow),
    ],
)
def test_driver_that_crashes_hangs_or_draws_nothing_is_rejected(monkeypatch, probe, draws):
    monkeypatch.setattr(opengl, "_PROBE", probe)
    monkeypatch.setattr(opengl, "_PROBE_SECONDS", 3)
    assert opengl.draws.__wrapped__("egl") is draws


@pytest.mark.parametrize(("backend", "order"), [("osmesa", "triton mujoco"), ("disable", "mujoco")])
def test_triton_is_loaded_before_mesa(tmp_path, backend, order):
    """Where MuJoCo loads Mesa's LLVM first, that of triton ends the process.

    The module `mujoco` is a fake, on which dm_control fails.
    """
    for name in ("triton", "mujoco"):
        (tmp_path / f"{name}.py").write_text(f"print('{name}', end=' ')")
    done = subprocess.run(
        [sys.executable, "-c", "import jbench.tasks, mujoco"],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, (tmp_path, ROOT))),
            "MUJOCO_GL": backend,
        },
        capture_output=True,
        text=True,
    )
    assert done.stdout.strip() == order
