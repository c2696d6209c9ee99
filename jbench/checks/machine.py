"""What `jbench doctor` looks at: whether this machine can do what the commands do, and how fast."""

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
import torch
from packaging.requirements import Requirement

from jbench.checks.checked import Checked
from jbench.cores import ONE_THREAD, cores
from jbench.errors import WorkError
from jbench.names import SHIPPED_RESULTS
from jbench.opengl import BACKENDS, draws, has_display
from jbench.revision import git_revision
from jbench.store import Results, files, locks
from jbench.store.manifest import KINDS
from jbench.store.provenance import processor
from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug.robots import load_model

DOCUMENTED_STEP = 11.0
"""Microseconds of the processor for a physics step of the robot on an AMD EPYC; docs/speed.md."""

_SLOW = 3.0  # times the documented step
_CONTROL_STEPS = 20  # of a measurement
_MEASUREMENTS = 10
_LITTLE_ROOM = 1e9  # bytes free


def check_machine(results: Results) -> Iterator[Checked]:
    """Yields a line for each check; the slow ones come last. Writes nothing that stays."""
    yield _versions()
    yield _dependencies()
    yield _cores()
    yield _threads()
    yield _gpu()
    yield _ffmpeg()
    yield _directory(results)
    yield _locks(results)
    yield _physics()
    yield _opengl()


def _versions() -> Checked:
    """Says which versions of jbench, Python and the main packages there are."""
    names = ("mujoco", "dm-control", "gymnasium", "numpy", "torch", "stable-baselines3", "duckdb")
    versions = {name: _version(name) for name in names}
    listed = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    jbench = f"jbench {_version('jbench')}"
    revision = git_revision()
    if revision:
        jbench += f" ({revision})"

    return Checked("versions", "ok", f"{jbench}, Python {platform.python_version()}, {listed}")


def _version(name: str) -> str | None:
    """Returns the version of a package, or None."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _dependencies() -> Checked:
    """Says which required packages are missing or have another version."""
    wrong = []
    for text in importlib.metadata.requires("jbench") or []:
        requirement = Requirement(text)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        version = _version(requirement.name)
        if version is None:
            wrong.append(f"{requirement.name} is missing")
        elif not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{requirement.name} is {version}, not {requirement.specifier}")

    if wrong:
        return Checked("dependencies", "fails", f"{'; '.join(wrong)}: type pip install jbench")

    return Checked("dependencies", "ok", "all installed, in versions that jbench permits")


def _cores() -> Checked:
    """Says how many cores jbench may use, and how busy they are."""
    usable = cores()
    whole = os.cpu_count() or 1
    parts = [f"{usable}"]
    if usable != whole:
        parts = [f"{usable} of {whole}: affinity or a quota leaves no more"]
    if hasattr(os, "getloadavg"):
        parts.append(f"load {os.getloadavg()[0]:.1f}")

    parts.append(f"{processor()}, {platform.machine()}")
    return Checked("cores", "ok", "; ".join(parts))


def _threads() -> Checked:
    """Says how many threads matrix products use, and what limits them."""
    blas = "unknown"
    configuration = np.show_config(mode="dicts")
    if isinstance(configuration, dict):
        blas = configuration["Build Dependencies"].get("blas", {}).get("name", "unknown")

    typed = [f"{name}={os.environ[name]}" for name in ONE_THREAD if name in os.environ]
    products = "MKL" if torch.backends.mkl.is_available() else "no MKL"
    text = f"torch has {torch.get_num_threads()} ({products}), numpy {blas}"
    return Checked("threads", "ok", f"{text}; {', '.join(typed) or 'no *_NUM_THREADS is set'}")


def _gpu() -> Checked:
    """Says which GPUs torch can use, after it has computed on one."""
    if not torch.cuda.is_available():
        built = f"for CUDA {torch.version.cuda}"
        if torch.version.cuda is None:
            built = "for CPUs only"
        return Checked("GPU", "ok", f"none that torch can use (torch is built {built})")

    try:
        names = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
        torch.ones(2, device="cuda").sum().item()
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        return Checked("GPU", "fails", f"it does not compute ({reason}): type --device cpu")

    return Checked("GPU", "ok", f"{', '.join(names)}; torch is built for CUDA {torch.version.cuda}")


def _ffmpeg() -> Checked:
    """Says which ffmpeg writes videos."""
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        return Checked("ffmpeg", "note", "no videos: type pip install 'jbench[render]'")

    import imageio_ffmpeg

    try:
        return Checked("ffmpeg", "ok", str(imageio_ffmpeg.get_ffmpeg_exe()))
    except RuntimeError:
        return Checked(
            "ffmpeg", "note", "no videos: install ffmpeg; pictures as .gif and .png work"
        )


def _directory(results: Results) -> Checked:
    """Says whether results can be written and locked, and how much room is left."""
    place = _existing(results.path)
    name = "results"
    if files.real(results.path) == files.real(SHIPPED_RESULTS):
        return Checked(name, "ok", f"{results.name}: shipped with jbench, read-only")

    try:
        with tempfile.TemporaryDirectory(prefix=".doctor-", dir=place) as folder:
            files.write_atomic(Path(folder) / "written", b"")
            with locks.hold(Path(folder), folder):
                locked = locks.is_held(Path(folder))
    except (OSError, WorkError) as error:
        reason = getattr(error, "strerror", None) or error
        return Checked(name, "fails", f"{results.name} can't be written and locked ({reason})")

    if not locked:
        text = f"{results.name} is on a file system without locks: run one command at a time there"
        return Checked(name, "note", text)

    title = f"{results.name}"
    if not results.path.exists():
        title += " (does not exist yet)"

    free = shutil.disk_usage(place).free
    text = f"{title}: writable, lockable, {free / 1e9:,.1f} GB free"
    if free < _LITTLE_ROOM:
        return Checked(name, "note", text)
    return Checked(name, "ok", text)


def _existing(path: Path) -> Path:
    """Returns the nearest place above a path that exists: a directory, unless it can't be made."""
    path = path.absolute()
    return next(parent for parent in (path, *path.parents) if os.path.lexists(parent))


def _locks(results: Results) -> Checked:
    """Says which records are being written now."""
    held = [
        f"{folder.kind} {folder.id}"
        for folder in chain.from_iterable(map(results.walk, KINDS))
        if locks.LOCK in folder.names and locks.is_held(folder.path)
    ]
    if not held:
        return Checked("locks", "ok", "no record is being written")
    return Checked("locks", "ok", f"being written now: {', '.join(held)}")


def _physics() -> Checked:
    """Measures a step of the physics, beside the time that the documentation has."""
    microseconds = physics_step()
    ratio = microseconds / DOCUMENTED_STEP
    text = (
        f"{microseconds:.1f} us of the processor per step, {ratio:.1f} times the documented "
        f"{DOCUMENTED_STEP:g} us"
    )
    if ratio > _SLOW:
        return Checked("physics", "note", text)
    return Checked("physics", "ok", text)


def physics_step() -> float:
    """Returns the microseconds of the processor for a physics step: the least of some rounds."""
    model = load_model()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=1000)  # falls to the floor
    controls = np.random.default_rng(0).uniform(-1, 1, (_MEASUREMENTS, _CONTROL_STEPS))
    seconds = []
    for commands in controls:
        began = time.process_time()
        for command in commands:
            data.ctrl[0] = command
            mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
        seconds.append(time.process_time() - began)

    return 1e6 * min(seconds) / (_CONTROL_STEPS * PHYSICS_STEPS)


def _opengl() -> Checked:
    """Says which backends of MuJoCo can draw pictures."""
    tried = [backend for backend in BACKENDS if backend != "glfw" or has_display()]
    working = [backend for backend in tried if draws(backend)]
    if not working:
        hint = "type apt install libosmesa6, or see docs/environments.md"
        return Checked(
            "OpenGL", "note", f"nothing draws pictures (tried {', '.join(tried)}): {hint}"
        )

    display = "a display" if has_display() else "no display"
    if len(working) == 1:
        return Checked("OpenGL", "ok", f"{working[0]} draws; {display}")
    return Checked("OpenGL", "ok", f"{', '.join(working)} draw; {display}")
