"""Where and by what a record was made: kept beside its settings, never in its id."""

import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

_PACKAGES = (
    "dm-control",
    "gymnasium",
    "mujoco",
    "numpy",
    "pyarrow",
    "stable-baselines3",
    "torch",
)

_DECISIVE = {"jbench", "python", "processor", "threads", "git_revision", *_PACKAGES}


def provenance() -> dict[str, Any]:
    """Returns versions, processor, threads, git revision and what was typed, as JSON values."""
    return {
        "jbench": importlib.metadata.version("jbench"),
        "python": platform.python_version(),
        "packages": {name: importlib.metadata.version(name) for name in _PACKAGES},
        "system": platform.platform(),
        "processor": processor(),
        "cores": cores(),
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "git_revision": git_revision(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Returns what may round numbers differently: [before, now] of each that is not the same.

    Args:
        before: what `provenance` returned when the work was begun.
        now: what it returns now.
    """
    then = {**before, **_packages(before)}
    return {
        name: [then.get(name), value]
        for name, value in {**now, **_packages(now)}.items()
        if name in _DECISIVE and then.get(name) != value
    }


def _packages(recorded: Mapping[str, Any]) -> Mapping[str, Any]:
    packages = recorded.get("packages")
    return packages if isinstance(packages, Mapping) else {}


def cores() -> int:
    """Returns how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def processor() -> str:
    """Returns the name of the processor, as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@cache
def git_revision() -> str | None:
    """Returns the revision of the checkout that jbench runs from, or None where it is installed."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        answer = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
