"""One walk over the records of a results directory, to list, check, copy or follow them."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jbench.store import files
from jbench.store.flaws import DamagedError, UnreadableError
from jbench.store.manifest import MANIFEST, Kind
from jbench.store.record import Record

# A part of an id becomes a directory: no separators and no leading dot.
ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}(?:/[A-Za-z0-9][A-Za-z0-9_.-]{0,99})*")
"""What an id looks like. Its hash is that of the record's settings."""


class Folder(NamedTuple):
    """A folder below a results directory.

    Attributes:
        id: path below the folder of the kind; the id of its record if it has one.
        names: of its files and symlinks; the manifest's name is included even if it is a folder.
        problem: why it can't be read, as a clause to follow the path, or None.
    """

    kind: Kind
    id: str
    path: Path
    names: tuple[str, ...] = ()
    problem: str | None = None

    def check(self) -> None:
        """Raises an `UnreadableError` if the folder can't be read."""
        if self.problem is not None:
            raise UnreadableError(self.path, self.problem)

    def read(self) -> Record | None:
        """Returns its record; None if it has no manifest, or no longer.

        Raises:
            RecordError: if the folder or the manifest can't be read, or is damaged.
        """
        self.check()
        if MANIFEST not in self.names:
            return None
        if not ID.fullmatch(self.id):
            raise DamagedError(self.path / MANIFEST, f"is in {self.id!r}, which is not an id")
        record = Record(self.path, self.kind, self.id)
        return record if record.load() else None


def walk(results: Path, kind: Kind, id: str = ".") -> Iterator[Folder]:
    """Yields a folder of a kind and all folders below it, sorted; nothing if it does not exist.

    Symlinks are not followed. Iterative, since folders may be nested deeper than Python's stack.
    """
    top = results / f"{kind}s"
    stack = [top / id]
    if not stack[0].resolve().is_relative_to(results.resolve()):
        problem = "leads out of the results directory; it is not used"
        yield Folder(kind, id, stack.pop(), problem=problem)
    while stack:
        path = stack.pop()
        id = path.relative_to(top).as_posix()
        try:
            entries = files.entries(path)
        except FileNotFoundError:
            continue
        except OSError as error:
            yield Folder(kind, id, path, problem=f"can't be read ({error.strerror})")
            continue
        below = {e.name for e in entries if e.is_dir(follow_symlinks=False)} - {MANIFEST}
        stack.extend(path / name for name in sorted(below, reverse=True))
        yield Folder(kind, id, path, tuple(e.name for e in entries if e.name not in below))


def look(results: Path, kind: Kind, id: str) -> Folder:
    """Returns one folder; an empty one if it does not exist."""
    return next(walk(results, kind, id), Folder(kind, id, results / f"{kind}s" / id))
