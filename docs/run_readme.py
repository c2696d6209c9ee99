"""Runs the commands of the README in a fresh clone, as someone does who has read no more.

    env -i PATH="$PATH" HOME="$HOME" python3 docs/run_readme.py

`make demo` and the lines without make are run, each in a clone of its own; `make test` and sudo are
left out, and the commands that take days.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = ("make test", "sudo")


def blocks(readme: str) -> list[str]:
    """Returns the indented blocks of commands, without those that are left out."""
    found = re.findall(r"(?:^    .*\n)+", readme, re.MULTILINE)
    lines = [
        [line for line in block.splitlines() if not line.strip().startswith(LEFT_OUT)]
        for block in found
        if "collect  " not in block
    ]
    return ["\n".join(block) for block in lines if block]


def main() -> None:
    """Runs each block by bash; the first that fails ends this with its exit code."""
    for block in blocks((ROOT / "README.md").read_text("utf-8")):
        with tempfile.TemporaryDirectory() as place:
            clone = Path(place) / "jbench"
            subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
            print(block, flush=True)
            done = subprocess.run(["bash", "-e", "-c", block], cwd=clone, check=False)
        if done.returncode:
            sys.exit(done.returncode)


if __name__ == "__main__":
    main()
