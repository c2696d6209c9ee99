"""The git revision of jbench."""

import subprocess
from functools import cache
from pathlib import Path


@cache
def git_revision() -> str | None:
    """Returns the git revision of the checkout, or None if jbench is installed."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():
        return None
    describe = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        answer = subprocess.run(describe, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
