"""Provenance of a record: versions, machine and command. It does not enter the id."""

import contextlib
import importlib.metadata
import os
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from jbench.cores import cores
from jbench.revision import git_revision
from jbench.wording import printable

if TYPE_CHECKING:
    import torch

_PACKAGES = ("dm-control", "gymnasium", "mujoco", "numpy", "pyarrow", "stable-baselines3", "torch")

_DECISIVE = {
    *_PACKAGES,
    "jbench",
    "python",
    "processor",
    "threads",
    "git_revision",
    "device",
    "gpu",
    "cuda",
    "driver",
    "package",
    "source_sha256",
    "task_package",
    "task_source_sha256",
}
"""Entries of provenance, and packages, that may round numbers differently if they change."""


def process_provenance() -> dict[str, Any]:
    """Returns versions, processor, threads, git revision and command, as JSON values."""
    return {
        "jbench": _version("jbench"),
        "python": platform.python_version(),
        "packages": package_versions(),
        "system": platform.platform(),
        "processor": processor(),
        "cores": cores(),
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "git_revision": git_revision(),
        # As a manifest allows it.
        "command": [printable(word) for word in (Path(sys.argv[0]).name, *sys.argv[1:])],
    }


def package_versions() -> dict[str, str]:
    """Returns the versions of the installed packages that numbers depend on."""
    versions = {name: _version(name) for name in _PACKAGES}
    return {name: version for name, version in versions.items() if version is not None}


@cache
def _version(package: str) -> str | None:
    """Returns the version of a package, as this process found it first; None if there is none."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def device_provenance(device: "torch.device") -> dict[str, str | None]:
    """Returns the device, "cpu" or "cuda", and the GPU, which it is, CUDA and driver versions."""
    if device.type != "cuda":
        return {"device": device.type}

    import torch

    return {
        "device": device.type,
        "gpu": torch.cuda.get_device_name(device),
        "gpu_device": f"cuda:{device.index or 0}",
        "cuda": torch.version.cuda,
        "driver": _driver(),
    }


def _driver() -> str | None:
    """Returns the version of the NVIDIA driver, if there is one."""
    with contextlib.suppress(OSError):
        return Path("/sys/module/nvidia/version").read_text("ascii").strip()
    return None


def differences(
    before: Mapping[str, Any], now: Mapping[str, Any], at_end: bool = False
) -> dict[str, list[Any]]:
    """Returns what may round numbers differently: [before, now] of each recorded change.

    The provenance before is that of the beginning of some work, or of where it was last continued.
    """
    recorded = {**before, **mapping(before.get("packages"))}
    if at_end:
        recorded |= last_changes(before)

    return {
        name: [recorded[name], value]
        for name, value in {**now, **now.get("packages", {})}.items()
        if name in _DECISIVE and name in recorded and recorded[name] != value
    }


def last_note(before: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns the note on where work was last continued; {} if it was not."""
    notes = before.get("continued")
    if not isinstance(notes, list) or not notes:
        return {}
    return mapping(notes[-1])


def last_changes(before: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the entries that differed where work was last continued, since its beginning."""
    changed = mapping(last_note(before).get("changed"))
    return {name: pair[-1] for name, pair in changed.items() if isinstance(pair, list) and pair}


def mapping(value: object) -> Mapping[str, Any]:
    """Returns a mapping in provenance; {} in place of what another program wrote."""
    if isinstance(value, Mapping):
        return value
    return {}


def utc_now() -> str:
    """Returns the time as manifests record it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def describe_changes(changed: Mapping[str, Sequence[object]]) -> str:
    """Returns `differences` as a clause, such as `mujoco 3.17.0 is now 3.18.0`."""
    names = {"git_revision": "jbench's git revision"}
    clauses = []
    for name, (before, now) in changed.items():
        if before is None:
            before = "unknown"
        clauses.append(f"{names.get(name, name)} {before} is now {now}")

    return ", ".join(clauses)


def shell_command(recorded: Mapping[str, Any]) -> str:
    """Returns the recorded command as it is typed in a shell, with the names of programs."""
    path, *arguments = map(str, recorded.get("command") or ["jbench"])
    program = PurePath(path.replace("\\", "/")).name
    if program == "__main__.py":
        program = "jbench"
    if program.endswith(".py"):
        return shlex.join(["python", program, *arguments])
    return shlex.join([program, *arguments])


@cache
def processor() -> str:
    """Returns the name of the processor."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def with_note(before: Mapping[str, Any], note: Mapping[str, Any]) -> dict[str, Any]:
    """Returns provenance with another note on where work was continued."""
    notes = before.get("continued")
    if not isinstance(notes, list):
        notes = []
    return {**before, "continued": [*notes, note]}


def with_more(before: Mapping[str, Any], facts: Mapping[str, Any]) -> dict[str, Any]:
    """Returns provenance with more facts in its last note on where work was continued."""
    *earlier, last = before["continued"]
    return {**before, "continued": [*earlier, {**last, **facts}]}
