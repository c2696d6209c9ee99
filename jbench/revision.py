"""The git revision of jbench: that of the checkout, or that of which the wheel was built."""

import subprocess
from functools import cache
from pathlib import Path

BUILT = "git_revision.txt"
"""The file that `setup.py` adds to a package which it builds from a checkout."""


@cache
def git_revision() -> str | None:
    """Returns the revision, such as `4655a54bd1c2` or `4655a54bd1c2-dirty`; None if unknown."""
    package = Path(__file__).resolve().parent
    root = package.parent
    if not (root / ".git").exists():
        built = package / BUILT
        if not built.is_file():
            return None
        return built.read_text("ascii").strip()

    # Without its tags, of which a release would have only the name and not the commit.
    describe = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    describe.append("--exclude=*")
    try:
        answer = subprocess.run(describe, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None

    return answer.stdout.strip()
