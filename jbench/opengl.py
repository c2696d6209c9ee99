"""Choice of the OpenGL backend, which MuJoCo, dm_control and Gymnasium read from MUJOCO_GL.

MuJoCo and dm_control read the variable at import, so choose before importing `jbench.tasks`. This
module imports only the standard library.
"""

import importlib.util
import os
import subprocess
import sys
import warnings
from functools import cache

from jbench.errors import RequestError

# Values of MUJOCO_GL: those that disable rendering, and the backends by window system, offscreen on
# a GPU or by Mesa, and offscreen by Mesa on the CPU.
OFF = ("disable", "disabled", "off", "false", "0")
BACKENDS = ("glfw", "egl", "osmesa")
_GLFW_ALIASES = ("enable", "enabled", "on", "true", "1")

_PROBE_SECONDS = 120  # generous, for a busy machine or a driver that is loaded for the first time

# Prints the brightness at the center of a white ball, in a child process, because a broken driver
# ends the process.
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
    """Returns a working backend, and sets MUJOCO_GL to it for this process.

    A backend in MUJOCO_GL is used if it works. Otherwise the first working one of "glfw" (if there
    is a display), "egl" and "osmesa" is used. Raises a RequestError if that in MUJOCO_GL, or every
    one, fails.
    """
    requested = os.environ.get("MUJOCO_GL", "").strip().lower()
    if requested in ("", *OFF):
        tried = [backend for backend in BACKENDS if backend != "glfw" or has_display()]
        failure = (
            f"Nothing here can draw pictures (tried {', '.join(tried)}): type apt install "
            "libosmesa6 (or libegl1 libgl1-mesa-dri, where Mesa is 25.1 or newer), or without root "
            "conda install -c conda-forge 'mesalib<25.1'."
        )
    else:
        tried = [requested]
        if requested in _GLFW_ALIASES:
            tried = ["glfw"]

        failure = f"MUJOCO_GL={requested} can't draw here; unset it to use a working backend."
        if tried[0] not in BACKENDS:
            raise RequestError(
                f"MUJOCO_GL={requested} is not a backend; set it to {', '.join(BACKENDS)}, or "
                "unset it."
            )

    for backend in tried:
        if draws(backend):
            os.environ["MUJOCO_GL"] = backend
            if backend != "glfw":
                # Another library may import PyOpenGL before MuJoCo does.
                os.environ.setdefault("PYOPENGL_PLATFORM", backend)
            return backend

    raise RequestError(failure)


def backend_failure() -> RequestError | None:
    """Chooses a backend; returns why none works, and then MuJoCo can be imported nonetheless.

    Without a backend, environments that need no OpenGL can still draw themselves.
    """
    try:
        choose_backend()
    except RequestError as failure:
        os.environ["MUJOCO_GL"] = OFF[0]
        return failure
    return None


def has_display() -> bool:
    """Returns whether the environment has a display for windows."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def open_display() -> bool:
    """Connects to the display; returns whether windows can be opened."""
    if not has_display():
        return False
    import glfw

    with warnings.catch_warnings(action="ignore"):
        return bool(glfw.init())


def import_triton_before_mesa() -> None:
    """Imports triton, where it is installed, unless MuJoCo has been imported.

    Triton is PyTorch's compiler for GPUs, which `torch.optim` imports. It ends the process
    (SIGSEGV) if Mesa's LLVM has been loaded before its own, as MuJoCo and dm_control load it on
    import where MUJOCO_GL is egl or osmesa.
    """
    loads_mesa = os.environ.get("MUJOCO_GL", "").strip().lower() in ("egl", "osmesa")
    if loads_mesa and "mujoco" not in sys.modules and importlib.util.find_spec("triton"):
        importlib.import_module("triton")


@cache
def draws(backend: str) -> bool:
    """Returns whether a process can draw a picture by a backend, one of `BACKENDS`."""
    probe = [sys.executable, "-c", _PROBE]
    env = {**os.environ, "MUJOCO_GL": backend}
    try:
        answer = subprocess.run(
            probe, env=env, capture_output=True, text=True, timeout=_PROBE_SECONDS
        )
    except subprocess.TimeoutExpired:
        return False

    # The exit code is ignored, since some drivers fail while they are unloaded.
    name, _, brightness = answer.stdout.strip().rpartition(" ")
    return name == "brightness" and brightness.isdecimal() and int(brightness) > 0
