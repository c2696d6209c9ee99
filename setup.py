"""What pyproject.toml can't say: the package's description, its files, and its git revision.

A package index has neither the images nor the pages that the README names by relative paths. The
wheel has all rows of the shipped runs, and the policies of `jbench/store/kept_policies.txt` only,
since all of them have 37 MB.
"""

import re
import shutil
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

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


def revision() -> str | None:
    """Returns the git revision of this checkout, or the one that a source distribution has."""
    spec = spec_from_file_location("revision", PACKAGE / "revision.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.git_revision()


class BuildAnew(build_py):
    """Builds the package of a wheel without what an earlier build left, and adds the git revision.

    setuptools keeps `build/lib`, and puts every file that lies there into the wheel.
    """

    def run(self) -> None:
        """Builds the package."""
        if self.editable_mode:
            super().run()
            return

        built = Path(self.build_lib) / "jbench"
        shutil.rmtree(built, ignore_errors=True)
        super().run()
        if known := revision():
            (built / "git_revision.txt").write_text(f"{known}\n", "ascii")


class SourceWithRevision(sdist):
    """Adds the git revision to a source distribution."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Writes the files."""
        super().make_release_tree(base_dir, files)
        if known := revision():
            (Path(base_dir) / "jbench" / "git_revision.txt").write_text(f"{known}\n", "ascii")


if __name__ == "__main__":
    setup(
        cmdclass={"build_py": BuildAnew, "sdist": SourceWithRevision},
        exclude_package_data={"jbench": left_out()},
        long_description=description(Path(__file__).with_name("README.md").read_text("utf-8")),
        long_description_content_type="text/markdown",
    )
