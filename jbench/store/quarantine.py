"""The quarantine of a results directory, where damaged and replaced records are kept.

It is set-aside/<time>/runs/face_direction/..., and nothing in it is a record of the results.
"""

import itertools
from datetime import UTC, datetime
from pathlib import Path

from jbench.store import files, locks
from jbench.store.database import Results
from jbench.store.folder import Folder
from jbench.store.manifest import MANIFEST


class Quarantine:
    """A new quarantine directory, created on first use."""

    def __init__(self, results: Results, dry_run: bool = False) -> None:
        """Chooses a new folder, which is made when the first record is moved there."""
        self.moved: dict[Path, Path] = {}
        self.dry_run = dry_run
        self._results = results
        root = results.inside("set-aside")
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
        # The clock may have been set back.
        names = itertools.chain((now,), (f"{now}-{n}" for n in itertools.count(2)))
        self._path = next(root / name for name in names if not (root / name).exists())

    def take(self, path: Path) -> None:
        """Moves a file or directory, keeping its path relative to the results."""
        if path not in self.moved:
            to = self._destination(path)
            if not self.dry_run:
                files.move(path, to)
            self.moved[path] = to

    def take_record(self, folder: Folder) -> None:
        """Moves the files of a folder of `Results.found`, its manifest first, but not its lock.

        Before, they get second names in the quarantine: where this process is killed between two of
        them, the next writer of the record removes those that no manifest lists any more.
        """
        folder.check()
        names = sorted(folder.names, key=lambda name: (name != MANIFEST, name))
        paths = [folder.path / name for name in names if name != locks.LOCK]
        if not self.dry_run:
            files.link({path: self._destination(path) for path in paths})

        for path in paths:
            self.take(path)

    def _destination(self, path: Path) -> Path:
        """Returns where a file of the results is moved."""
        return self._path / path.relative_to(self._results.path)
