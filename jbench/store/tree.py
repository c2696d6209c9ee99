"""Walking the directories of a results directory."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jbench.store import files
from jbench.store.manifest import MANIFEST


class Folder(NamedTuple):
    """A folder below a results directory.

    Attributes:
        names: of its files and symlinks; the manifest's name is included even if it is a folder.
        problem: why it can't be read, or None.
    """

    path: Path
    names: tuple[str, ...]
    problem: str | None = None

    @property
    def is_record(self) -> bool:
        """Whether it contains a manifest."""
        return MANIFEST in self.names


def walk(root: Path) -> Iterator[Folder]:
    """Yields a folder and all folders below it, sorted; yields nothing if it does not exist.

    Symlinks are not followed. Iterative, since folders may be nested deeper than Python's stack.
    """
    stack = [root]
    while stack:
        path = stack.pop()
        try:
            entries = files.entries(path)
        except FileNotFoundError:
            continue
        except OSError as error:
            yield Folder(path, (), f"can't be read ({error.strerror})")
            continue
        folders = [entry for entry in entries if entry.is_dir(follow_symlinks=False)]
        below = [path / entry.name for entry in folders if entry.name != MANIFEST]
        stack.extend(reversed(below))
        plain = {entry.name for entry in entries} - {folder.name for folder in below}
        yield Folder(path, tuple(sorted(plain)))


def folder_at(path: Path) -> Folder:
    """Returns one folder; an empty one if it does not exist."""
    return next(walk(path), Folder(path, ()))
