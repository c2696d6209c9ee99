"""Tests of the choice of the OpenGL backend, and of its error messages."""

import os
import subprocess
import sys

import pytest

from jbench import opengl
from jbench.errors import RequestError
from jbench.opengl import choose_backend

CHOOSE = """
import os, sys
from jbench.errors import RequestError
from jbench.opengl import choose_backend
try:
    print(choose_backend(), os.environ["MUJOCO_GL"], "mujoco" in sys.modules)
except RequestError as error:
    print(error)
"""

DRAW = """
import gymnasium, os
env = gymnasium.make("jbench.tasks:Jitterbug/FaceDirection-v0", render_mode="rgb_array")
env.reset(seed=0)
print(env.render().std() > 10, os.environ["MUJOCO_GL"])
env.close()
"""

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems have other backends")


def answer_of(script, **environment):
    """Returns the output of a script in a process without a display."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in (*_DISPLAYS, "MUJOCO_GL", "PYOPENGL_PLATFORM")
    }
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def fake_machine(monkeypatch):
    """Returns a function that fakes the working backends and the display of a machine."""

    def fake(works, mujoco_gl="", display=""):
        tried = []
        for name in ("PYOPENGL_PLATFORM", *_DISPLAYS):
            monkeypatch.setenv(name, "")
        monkeypatch.setenv("MUJOCO_GL", mujoco_gl)
        monkeypatch.setenv("DISPLAY", display)
        monkeypatch.setattr(opengl, "_draws", lambda name: (tried.append(name), name in works)[1])
        return tried

    return fake


@on_linux
@pytest.mark.usefixtures("rendering")
@pytest.mark.parametrize("switched_off", [{}, {"MUJOCO_GL": "disable"}])
def test_working_backend_is_found_without_display(switched_off):
    chosen, variable, loaded = answer_of(CHOOSE, **switched_off).split()
    assert chosen == variable
    assert chosen in ("egl", "osmesa")
    assert loaded == "False"  # MuJoCo reads the variable when it is first imported


@on_linux
@pytest.mark.usefixtures("rendering")
def test_environment_renders_without_display_or_setting():
    drawn, variable = answer_of(DRAW).split()
    assert drawn == "True"
    assert variable in ("egl", "osmesa")


@on_linux
@pytest.mark.parametrize(
    ("mujoco_gl", "says"),
    [
        ("", r"can draw pictures \(tried egl, osmesa\): type apt .* libosmesa6 .* conda-forge"),
        ("EGL", "^MUJOCO_GL=egl can't draw here; unset it to use a working backend.$"),
    ],
)
def test_failing_backends_are_refused(fake_machine, mujoco_gl, says):
    fake_machine(works=(), mujoco_gl=mujoco_gl)
    with pytest.raises(RequestError, match=says):
        choose_backend()


def test_unknown_backend_is_refused(fake_machine):
    tried = fake_machine(works=opengl.BACKENDS, mujoco_gl="vulkan")
    with pytest.raises(RequestError, match=r"^MUJOCO_GL=vulkan is not a backend; set it to glfw"):
        choose_backend()
    assert tried == []


@on_linux
@pytest.mark.parametrize(
    ("works", "display", "tried"),
    [
        (("glfw", "egl", "osmesa"), ":0", ["glfw"]),
        (("glfw", "egl", "osmesa"), "", ["egl"]),
        (("osmesa",), ":0", ["glfw", "egl", "osmesa"]),
    ],
)
def test_first_working_backend_is_used(fake_machine, works, display, tried):
    attempts = fake_machine(works, display=display)
    assert choose_backend() == tried[-1] == os.environ["MUJOCO_GL"]
    assert attempts == tried


@pytest.mark.parametrize(
    ("value", "chosen"), [("glfw", "glfw"), (" OSMesa ", "osmesa"), ("on", "glfw")]
)
def test_mujoco_gl_is_parsed_as_mujoco_does(fake_machine, value, chosen):
    attempts = fake_machine(works=opengl.BACKENDS, mujoco_gl=value)
    assert choose_backend() == chosen == os.environ["MUJOCO_GL"]
    assert attempts == [chosen]


@pytest.mark.parametrize(
    ("probe", "draws"),
    [
        ("print('brightness', 173)", True),
        ("print('brightness', 173, flush=True); import os; os.abort()", True),  # while unloading
        ("print('brightness', 0)", False),
        ("import os; os.abort()", False),
        ("raise ImportError", False),
        ("import time; time.sleep(600)", False),
    ],
)
def test_driver_that_crashes_hangs_or_draws_nothing_is_rejected(monkeypatch, probe, draws):
    monkeypatch.setattr(opengl, "_PROBE", probe)
    monkeypatch.setattr(opengl, "_PROBE_SECONDS", 3)
    assert opengl._draws.__wrapped__("egl") is draws
