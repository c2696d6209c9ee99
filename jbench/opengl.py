"""Which OpenGL draws: MuJoCo, dm_control and Gymnasium all read it from MUJOCO_GL.

MuJoCo and dm_control read the variable once, when they are first imported: choose before you
import `jbench.tasks`. Hence this module imports nothing but the standard library.
"""

import os
import subprocess
import sys
from functools import cache

from jbench.errors import RequestError

OFF = ("disable", "disabled", "off", "false", "0")
"""Values of MUJOCO_GL that mean: nothing will be drawn."""

BACKENDS = ("glfw", "egl", "osmesa")
"""Window system, off the screen on a GPU or by Mesa, off the screen by Mesa on the processor."""

_GLFW_TOO = ("enable", "enabled", "on", "true", "1")

# Generous: a busy machine, a driver that is loaded for the first time.
_PROBE_SECONDS = 120

# Prints the brightness of the middle of a white ball. In another process, because a broken driver
# does not raise: it ends the process.
_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom size='1' rgba='1 1 1 1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 16, 16) as renderer:
    renderer.update_scene(data)
    print("brightness", renderer.render()[8, 8].max())
"""


def choose_backend() -> str:
    """Returns a backend that draws here, and sets MUJOCO_GL to it for this process.

    A backend named by MUJOCO_GL is kept, if it works. Else the first that works: "glfw" where
    there is a display, "egl", "osmesa".

    Raises:
        RequestError: if none works, or the one that MUJOCO_GL names; it says what to install.
    """
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if asked and asked not in OFF:
        backend = "glfw" if asked in _GLFW_TOO else asked
        if backend not in BACKENDS:
            raise RequestError(
                f"MUJOCO_GL={asked} is no backend; set it to {', '.join(BACKENDS)}, or unset it."
            )
        if not _draws(backend):
            raise RequestError(
                f"MUJOCO_GL={asked} can't draw here; unset it, and one that can is looked for."
            )
        return _use(backend)
    tried = [backend for backend in BACKENDS if backend != "glfw" or has_display()]
    for backend in tried:
        if _draws(backend):
            return _use(backend)
    raise RequestError(
        f"Nothing here can draw pictures (tried {', '.join(tried)}): type apt install libosmesa6 "
        "(or libegl1 libgl1-mesa-dri, where Mesa is 25.1 or newer), or without root's rights "
        "conda install -c conda-forge 'mesalib<25.1'."
    )


def has_display() -> bool:
    """Returns whether windows can be opened, as far as the environment tells."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def _use(backend: str) -> str:
    os.environ["MUJOCO_GL"] = backend
    if backend != "glfw":
        # Some other user of PyOpenGL may import it before MuJoCo does.
        os.environ.setdefault("PYOPENGL_PLATFORM", backend)
    return backend


@cache
def _draws(backend: str) -> bool:
    """Returns whether a backend draws a ball that is not black."""
    try:
        answer = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env={**os.environ, "MUJOCO_GL": backend},
            capture_output=True,
            text=True,
            timeout=_PROBE_SECONDS,
        )
    except subprocess.TimeoutExpired:
        return False
    # Not the exit code: some drivers fail only while they are unloaded.
    name, _, brightness = answer.stdout.strip().rpartition(" ")
    return name == "brightness" and brightness.isdecimal() and int(brightness) > 0
