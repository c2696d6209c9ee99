"""The files of a folder that have learning curves."""

from collections.abc import Sequence
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
    curves of others. Raises a RequestError if there are none.
    """
    if not path.is_dir():
        return Found([path])

    of_sb3 = [("*monitor.csv",), ("evaluations*.npz",)]
    if returns == "evaluation":
        of_sb3.reverse()

    kinds = [*of_sb3, ("*.csv", "*.json"), ("progress.txt",), ("*.tfevents.*",)]
    records = {file.parent for file in path.rglob(MANIFEST) if _is_of_record(file)}
    reports = {file.parent for file in path.rglob(LISTING) if file.with_name(PAGE).is_file()}
    ours = records | reports
    by_kind = [
        sorted(
            file
            for pattern in patterns
            for file in path.rglob(pattern)
            if ours.isdisjoint(file.parents)
        )
        for patterns in kinds
    ]
    found = next((files for files in by_kind if files), [])
    if not found and records:
        raise RequestError(
            f"{path} is a results directory of jbench; type --results {path} instead of --curves."
        )
    if not found:
        raise RequestError(
            f"{path} is a directory without a .csv, .json, .npz or event file; name a file."
        )

    every = dict.fromkeys(file for files in by_kind for file in files)
    return Found(found, [file for file in every if file not in set(found)])


def _is_of_record(manifest: Path) -> bool:
    """Returns whether a file is the manifest of a record of jbench, by its first key."""
    with manifest.open("rb") as file:
        return b'"schema_version"' in file.read(_BEGINNING)
