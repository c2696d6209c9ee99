"""The description of the package: the README without what only a checkout can show.

A package index has neither the images nor the pages that the README names by relative paths.
"""

import re
from pathlib import Path

from setuptools import setup


def description(readme: str) -> str:
    """Returns the README without images; relative links become plain text."""
    without_images = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n*", "", readme)
    return re.sub(r"\[([^\]]*)\]\((?!https?:|#)[^)]*\)", r"\1", without_images)


if __name__ == "__main__":
    setup(
        long_description=description(Path(__file__).with_name("README.md").read_text("utf-8")),
        long_description_content_type="text/markdown",
    )
