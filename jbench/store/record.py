"""A record: its manifest, which is the commit, and its files.

`docs/durability.md` describes how a commit is made.
"""

import contextlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import pyarrow as pa

from jbench.errors import WorkError
from jbench.names import Status
from jbench.store import files, record_files, schema
from jbench.store.folder import Folder
from jbench.store.manifest import ID, MANIFEST, FileEntry, Json, Manifest, RecordKind
from jbench.store.provenance import differences, process_provenance, utc_now, with_more, with_note
from jbench.wording import with_results

_Read = TypeVar("_Read")


@dataclass(eq=False, repr=False)
class Record:
    """A dataset, an encoder, a run, an evaluation or an import: its manifest and its files.

    `in_folder` reads it. Files that its folder `may_lack`, and lacks, are taken from the list of
    the manifest: they are `left_out`, as most policies are of the wheel's results.
    """

    folder: Folder
    manifest: Manifest
    left_out: tuple[FileEntry, ...] = ()

    @classmethod
    def in_folder(cls, folder: Folder) -> Self | None:
        """Returns the record of a folder, or None if there is no manifest.

        Raises an `UnreadableError` if the folder can't be read; see `Manifest.read` for others.
        """
        folder.check()
        path = folder.path / MANIFEST
        manifest = Manifest.read(path) if MANIFEST in folder.names else None
        if manifest is None:
            return None
        if not ID.fullmatch(folder.id):
            raise files.DamagedError(path, f"is in {folder.id!r}, which is not an id")

        named = f"{manifest.kind} {manifest.id}"
        if named != f"{folder.kind} {folder.id}":
            raise files.DamagedError(path, f"calls itself {named}; it is not read")

        left_out = tuple(filter(folder.has_left_out, manifest.files))
        if left_out:
            there = tuple(entry for entry in manifest.files if entry not in left_out)
            manifest = manifest.model_copy(update={"files": there})

        return cls(folder, manifest, left_out)

    @classmethod
    def begin(cls, folder: Folder, manifest: Manifest) -> Self:
        """Makes the record of a folder, or replaces what it holds.

        As all methods that write, raises a RequestError if the directory is not writable, and a
        WorkError if the disk is full or fails.
        """
        files.make_directory(folder.path)
        files.write_atomic(folder.path / MANIFEST, manifest.to_bytes())
        record = cls(folder, manifest)
        record.clean()
        return record

    def copy_to(self, folder: Folder) -> Self:
        """Copies the record, which is intact, to a folder of other results, which is locked."""
        for entry in self.manifest.files:
            files.write_atomic(folder.path / entry.name, record_files.read(self.path, entry))
        return self.begin(folder, self.manifest)

    @property
    def path(self) -> Path:
        """The directory of the record."""
        return self.folder.path

    @property
    def kind(self) -> RecordKind:
        """What it is a record of."""
        return self.folder.kind

    @property
    def id(self) -> str:
        """Its id."""
        return self.folder.id

    def reading(self, read: Callable[[], _Read]) -> _Read:
        """Returns what a function reads; it reads again if a writer has joined the files."""
        while True:
            try:
                return read()
            except WorkError:
                if not self.refresh():
                    raise

    def refresh(self) -> bool:
        """Reads the manifest again; returns whether it has changed."""
        # Compared as bytes, since a summary may contain NaN, which never equals itself.
        before = self.manifest.to_bytes()
        with contextlib.suppress(WorkError):
            now = self.in_folder(self.folder)
            if now is not None:
                self.manifest = now.manifest
                self.left_out = now.left_out
        return self.manifest.to_bytes() != before

    @property
    def status(self) -> Status:
        """The state of the work."""
        return self.manifest.status

    @property
    def is_finished(self) -> bool:
        """Whether the work has succeeded, so that it is not repeated."""
        return self.status == "finished"

    @property
    def error(self) -> str | None:
        """Why the work failed; None if it did not."""
        return str(self.manifest.summary.get("error")) if self.status == "failed" else None

    @property
    def settings(self) -> dict[str, Any]:
        """What produced the record."""
        return self.manifest.settings

    @property
    def size(self) -> int:
        """Bytes of the committed files."""
        return sum(entry.bytes for entry in self.manifest.files)

    def rows(self, table: str) -> int:
        """Returns the number of committed rows of a table."""
        return sum(entry.rows for entry in self.parts(table))

    def parts(self, table: str) -> list[FileEntry]:
        """Returns the committed files of a table in the order of writing."""
        return [entry for entry in self.manifest.files if entry.table == table]

    def roles(self) -> list[str]:
        """Returns the roles of all checkpoints in the order of writing."""
        return [entry.role for entry in self.manifest.files if entry.role is not None]

    def read(self, table: str, columns: pa.Schema | None = None) -> pa.Table:
        """Returns the committed rows of a table, by default all columns; raises a RecordError."""
        columns = schema.FILES[table] if columns is None else columns
        parts = [self.read_part(entry, columns) for entry in self.parts(table)]
        return pa.concat_tables([columns.empty_table(), *parts])

    def read_part(self, entry: FileEntry, columns: pa.Schema | None = None) -> pa.Table:
        """Returns the rows of one file, by default with the columns that it has; see `read`."""
        return record_files.read_rows(self.path, entry, self.advice, columns, self.manifest.is_old)

    def read_file(self, name: str) -> bytes:
        """Returns the content of a committed file by its name or role; see `record_files.read`."""
        for entry in self.manifest.files:
            if name in (entry.name, entry.role):
                return record_files.read(self.path, entry, self.advice)
        raise WorkError(f"The {self.kind} {self.id} has no file {name}.")

    @property
    def advice(self) -> str:
        """What to do if a file is damaged, as a clause."""
        results = self.path.parents[len(Path(self.id).parts)]
        return f"restore it, or set it aside with `{with_results('jbench repair', results)}`"

    def append(
        self,
        tables: Mapping[str, pa.Table],
        checkpoints: Mapping[str, bytes] | None = None,
        *,
        drop: Collection[str] = (),
        replace: Collection[str] = (),
    ) -> None:
        """Adds rows to tables and replaces checkpoints in one atomic commit.

        `checkpoints` are the state to resume after these rows: content by role, a file name such as
        `checkpoint.safetensors`, which replaces the previous file of the role. `drop` are roles to
        remove; of the tables to `replace`, the existing rows are dropped.
        """
        states = checkpoints or {}
        added = [self._write_rows(name, rows) for name, rows in tables.items() if rows.num_rows]
        # The previous ones stay intact until the commit.
        added += record_files.write_checkpoints(self.path, states)

        before = self.manifest.files
        dropped = {*states, *drop}
        kept = [e for e in before if e.role not in dropped and e.table not in replace]
        after = {entry.name: entry for entry in (*kept, *added)}  # the same rows are the same file
        self._update(files=tuple(after.values()))
        files.remove(self.path / entry.name for entry in before if entry.name not in after)

    def resume(self, where: Json, made_on: Json | None = None) -> dict[str, list[Any]]:
        """Records that work is resumed, and where; returns the `differences` of provenance."""
        before = self.manifest.provenance
        changed = differences(before, {**process_provenance(), **(made_on or {})})
        made = with_note(before, {"at": utc_now(), **where, "changed": changed})
        self._update(status="unfinished", summary={}, provenance=made)
        return changed

    def note(self, facts: Json) -> None:
        """Adds facts to what the last call of `resume` recorded."""
        self._update(provenance=with_more(self.manifest.provenance, facts))

    def finish(
        self,
        summary: Json,
        new_files: Mapping[str, bytes] | None = None,
        join: bool = True,
        keep: Collection[str] = (),
        checkpoints: Mapping[str, bytes] | None = None,
    ) -> None:
        """Marks the record as finished, adds files by name, and removes checkpoints not to keep.

        If `join`, each table becomes one file, which must fit in memory. `keep` are roles
        of checkpoints, and `checkpoints` are new ones by role.
        """
        before = self.manifest.files
        kept = [e for e in before if e.table is None and (e.role is None or e.role in keep)]
        parts = [entry for entry in before if entry.table is not None]
        if join:
            parts = [self._join(table) for table in dict.fromkeys(e.table or "" for e in parts)]

        added = [record_files.write(self.path, *item) for item in (new_files or {}).items()]
        added += record_files.write_checkpoints(self.path, checkpoints or {})
        entries = (*kept, *parts, *added)
        self._update(status="finished", summary=dict(summary), files=entries)
        self.clean()

    def fail(self, error: str, details: Json | None = None) -> None:
        """Marks the work as failed, by a sentence and details for the summary; keeps its data."""
        self._update(status="failed", summary={"error": error, **(details or {})})

    def clean(self) -> None:
        """Removes uncommitted files; call it while holding the lock. Errors are ignored."""
        with contextlib.suppress(OSError):
            files.remove(self.uncommitted())

    def uncommitted(self) -> list[Path]:
        """Returns the files that an interrupted writer left; see `files.WRITTEN`."""
        committed = {MANIFEST, *(entry.name for entry in self.manifest.files)}
        names = (e.name for e in files.entries(self.path) if not e.is_dir(follow_symlinks=False))
        return [self.path / n for n in names if files.WRITTEN.fullmatch(n) and n not in committed]

    def _join(self, table: str) -> FileEntry:
        """Returns the only file of a table, after its parts are joined."""
        parts = self.parts(table)
        if len(parts) == 1:
            return parts[0]
        # Parts of an older version may lack a column, which becomes null.
        rows = pa.concat_tables([self.read_part(part) for part in parts], promote_options="default")
        return self._write_rows(table, rows)

    def _write_rows(self, table: str, rows: pa.Table) -> FileEntry:
        """Writes rows of a table to a new file, which is the record's from the next commit on."""
        return record_files.write_rows(self.path, table, rows, number=len(self.parts(table)))

    def _update(self, **changes: Any) -> None:
        """Writes the manifest with changes at once, which is the commit."""
        manifest = self.manifest.model_copy(update={"updated": utc_now(), **changes})
        files.write_atomic(self.path / MANIFEST, manifest.to_bytes())
        self.manifest = manifest
