"""What pyproject.toml can't say: the description of the package, and which policies it leaves out.

A package index has neither the images nor the pages that the README names by relative paths. The
wheel has all rows of the shipped runs, and the policies of `jbench/store/kept_policies.txt` only,
since all of them have 37 MB.
"""

import re
from pathlib import Path

from setuptools import setup

PACKAGE = Path(__file__).parent / "jbench"


def description(readme: str) -> str:
    """Returns the README without images; relative links become plain text."""
    without_images = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n*", "", readme)
    return re.sub(r"\[([^\]]*)\]\((?!https?:|#)[^)]*\)", r"\1", without_images)


def left_out() -> list[str]:
    """Returns the files of the policies that are not in the wheel, relative to the package."""
    kept = (PACKAGE / "store" / "kept_policies.txt").read_text("utf-8").splitlines()
    runs = PACKAGE / "reference" / "runs"
    return [
        path.relative_to(PACKAGE).as_posix()
        for path in runs.rglob("policy.*")
        if path.parent.relative_to(runs).as_posix() not in kept
    ]


if __name__ == "__main__":
    setup(
        exclude_package_data={"jbench": left_out()},
        long_description=description(Path(__file__).with_name("README.md").read_text("utf-8")),
        long_description_content_type="text/markdown",
    )
