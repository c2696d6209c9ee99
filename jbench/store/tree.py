"""The folders of a results directory, as they lie on the disk."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jbench.store.manifest import MANIFEST


class Folder(NamedTuple):
    """A folder below a results directory.

    Attributes:
        path: of it.
        names: of what lies in it and is no folder, links among it; and of the manifest, whatever
            stands in its place.
        problem: why it can't be read, or None.
    """

    path: Path
    names: tuple[str, ...]
    problem: str | None = None

    @property
    def is_record(self) -> bool:
        """Whether a manifest lies in it."""
        return MANIFEST in self.names


def walk(root: Path) -> Iterator[Folder]:
    """Gives a folder and all below it, sorted; links are not followed, and no folder is none.

    It keeps its own list of what is to come: folders may lie deeper in each other than Python
    calls functions.
    """
    waiting = [root]
    while waiting:
        path = waiting.pop()
        try:
            with os.scandir(path) as found:
                entries = sorted(found, key=lambda entry: entry.name)
        except FileNotFoundError:
            continue
        except OSError as error:
            yield Folder(path, (), f"can't be read ({error.strerror})")
            continue
        folders = [entry for entry in entries if entry.is_dir(follow_symlinks=False)]
        below = [path / entry.name for entry in folders if entry.name != MANIFEST]
        waiting.extend(reversed(below))
        plain = {entry.name for entry in entries} - {folder.name for folder in below}
        yield Folder(path, tuple(sorted(plain)))
