"""The files of a folder that have learning curves."""

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from jbench.errors import RequestError
from jbench.names import LISTING, PAGE, ReturnsName
from jbench.store.manifest import MANIFEST
from jbench.wording import are, counted

_BEGINNING = 100  # bytes of a manifest, which have its first key


class Found(NamedTuple):
    """The files that are read, and others of a folder that may have curves."""

    files: Sequence[Path]
    others: Sequence[Path] = ()

    @property
    def notes(self) -> list[str]:
        """A sentence on the other files, if there are some."""
        if not self.others:
            return []

        such = f"{self.others[0].parent.name}/{self.others[0].name}"
        left = f"{counted(len(self.others), 'file')} such as {such}"
        return [
            f"The folder has files such as {self.files[0].name}, so {left} "
            f"{are(len(self.others))} left out; name a file, or a folder that has files of one "
            "kind."
        ]


def curve_files(path: Path, returns: ReturnsName) -> Found:
    """Returns the files of a folder that have curves, of the kind of return that is asked for.

    They are of the first kind of file that the folder has. Reports and records of jbench have no
    curves of others, and neither have hidden files, such as those that macOS and Jupyter put beside
    files. Raises a RequestError if there are none.
    """
    if not path.is_dir():
        return Found([path])

    of_sb3 = [("*monitor.csv",), ("evaluations*.npz",)]
    if returns == "evaluation":
        of_sb3.reverse()

    kinds = [*of_sb3, ("*.csv", "*.json"), ("progress.txt",), ("*.tfevents.*",)]
    visible = [file for file in sorted(path.rglob("*")) if _is_visible_file(file, path)]
    records = {each.parent for each in visible if each.name == MANIFEST and _is_of_record(each)}
    reports = {each.parent for each in visible if _is_of_report(each)}
    by_kind = [_matches(visible, patterns, records | reports) for patterns in kinds]
    files_of_first_kind = next(filter(None, by_kind), [])
    if not files_of_first_kind and records:
        raise RequestError(
            f"{path} is a results directory of jbench; type --results {path} instead of --curves."
        )
    if not files_of_first_kind:
        raise RequestError(
            f"{path} is a directory without a .csv, .json, .npz or event file; name a file."
        )

    # A file may match the patterns of several kinds.
    others = dict.fromkeys(chain.from_iterable(by_kind))
    for file in files_of_first_kind:
        del others[file]

    return Found(files_of_first_kind, [*others])


def _is_visible_file(path: Path, folder: Path) -> bool:
    """Returns whether a path is a file, of whose names below a folder none is hidden."""
    is_hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
    return not is_hidden and path.is_file()


def _matches(files: Iterable[Path], patterns: Sequence[str], left_out: set[Path]) -> list[Path]:
    """Returns the files that match a pattern in any case, but none in folders to leave out."""
    return [
        file
        for file in files
        if any(fnmatchcase(file.name.lower(), pattern) for pattern in patterns)
        and left_out.isdisjoint(file.parents)
    ]


def _is_of_report(file: Path) -> bool:
    """Returns whether a file is the list of the files of a report of jbench."""
    return file.name == LISTING and file.with_name(PAGE).is_file()


def _is_of_record(manifest: Path) -> bool:
    """Returns whether a file is the manifest of a record of jbench, by its first key."""
    with manifest.open("rb") as file:
        return b'"schema_version"' in file.read(_BEGINNING)
