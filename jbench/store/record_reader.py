"""Reading a record: its manifest, and its files, which are checked against the manifest."""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from jbench.errors import WorkError
from jbench.store import files, parquet, schema
from jbench.store.manifest import MANIFEST, SCHEMA_VERSION, FileEntry, Kind, Manifest, Status
from jbench.store.older import upgraded
from jbench.wording import with_results

_MAX_MANIFEST = 1 << 26  # bytes; a manifest of 100,000 files has half as many


class RecordReader:
    """Read access to a dataset, an encoder, a run, an evaluation or an import."""

    manifest: Manifest

    def __init__(self, path: Path, kind: Kind, id: str) -> None:
        """Refers to a record; `create` and `load` set its manifest."""
        self.path, self.kind, self.id = path, kind, id

    def load(self) -> bool:
        """Reads the manifest; returns whether it exists.

        Raises:
            UnreadableError: if reading it fails, perhaps temporarily.
            WorkError: if it is damaged or of another record.
        """
        path = self.path / MANIFEST
        try:
            with files.open_plain(path) as file:
                content = file.read(_MAX_MANIFEST + 1)
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError as error:
            kind = files.UnreadableError if files.is_transient(error) else WorkError
            raise kind(f"{path} can't be read ({error.strerror}).") from None
        if len(content) > _MAX_MANIFEST:
            raise WorkError(f"{path} is larger than any manifest; it is not read.")
        self.manifest = Manifest.from_bytes(content, str(path))
        if (self.manifest.kind, self.manifest.id) != (self.kind, self.id):
            raise WorkError(
                f"{path} calls itself {self.manifest.kind} {self.manifest.id}; it is not read."
            )
        return True

    @property
    def status(self) -> Status:
        """Whether the work is unfinished, finished or failed."""
        return self.manifest.status

    @property
    def error(self) -> str | None:
        """Why the work failed; None if it did not."""
        return str(self.manifest.summary.get("error")) if self.status == "failed" else None

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that produced the record."""
        return self.manifest.settings

    @property
    def size(self) -> int:
        """Bytes of the committed files."""
        return sum(entry.bytes for entry in self.manifest.files)

    def refresh(self) -> bool:
        """Reads the manifest again; returns whether it has changed.

        Files may disappear after a reader has read the manifest, when a writer joins them.
        """
        # Compared as bytes, since an untrusted manifest may contain NaN, which never equals itself.
        before = self.manifest.to_bytes()
        with contextlib.suppress(WorkError):
            self.load()
        return self.manifest.to_bytes() != before

    def rows(self, table: str) -> int:
        """Returns the number of committed rows of a table."""
        return sum(entry.rows for entry in self.parts(table))

    def read(self, table: str, columns: pa.Schema | None = None) -> pa.Table:
        """Returns all committed rows of a table, checked against the manifest.

        Args:
            columns: to return; None for all columns of `jbench.store.schema.FILES`.

        Raises:
            WorkError: if a file is missing or damaged, or lacks a column.
        """
        columns = schema.FILES[table] if columns is None else columns
        parts = [self.read_part(entry, columns) for entry in self.parts(table)]
        return pa.concat_tables([columns.empty_table(), *parts])

    def read_part(self, entry: FileEntry, columns: pa.Schema) -> pa.Table:
        """Returns the rows of one file, checked against the manifest; see `read`."""
        dictionaries = [field.name for field in columns if pa.types.is_dictionary(field.type)]
        if self.manifest.schema_version < SCHEMA_VERSION and entry.table is not None:
            rows = upgraded(entry.table, self.rows_of(entry, dictionaries), columns)
        else:
            rows = self.rows_of(entry, dictionaries, columns.names)
        if rows.schema.equals(columns, check_metadata=True):
            return rows  # a cast takes a sixth of the time of reading
        for name in columns.names:
            if name not in rows.column_names:
                reason = f"it has no column {name}: another version of jbench wrote it"
                raise self._damaged(entry, reason)
        try:
            return rows.select(columns.names).cast(columns)
        except (pa.ArrowException, KeyError) as error:
            raise self._damaged(entry, str(error).splitlines()[0]) from None

    def parts(self, table: str) -> list[FileEntry]:
        """Returns the committed files of a table in the order of writing."""
        return [entry for entry in self.manifest.files if entry.table == table]

    def read_file(self, name: str) -> bytes:
        """Returns the content of a committed file by its name or role.

        Raises:
            WorkError: if the file does not exist or is damaged.
        """
        for entry in self.manifest.files:
            if name in (entry.name, entry.role):
                return self._content_of(entry)
        raise WorkError(f"The {self.kind} {self.id} has no file {name}.")

    def roles(self) -> list[str]:
        """Returns the roles of all checkpoints in the order of writing."""
        return [entry.role for entry in self.manifest.files if entry.role is not None]

    def rows_of(
        self,
        entry: FileEntry,
        dictionaries: Sequence[str] = (),
        columns: Sequence[str] | None = None,
    ) -> pa.Table:
        """Returns columns of one file, checked; see `parquet.from_bytes`."""
        content = self._content_of(entry)
        try:
            return parquet.from_bytes(content, entry.rows, dictionaries, columns)
        except ValueError as error:
            raise self._damaged(entry, str(error)) from None

    def _content_of(self, entry: FileEntry) -> bytes:
        """Returns the content of a file, checked against the manifest."""
        try:
            with files.open_plain(self.path / entry.name) as file:
                size = os.fstat(file.fileno()).st_size
                if size != entry.bytes:
                    raise self._damaged(entry, f"{size} bytes, not {entry.bytes}")
                content = file.read()
        except OSError as error:
            if files.is_transient(error):
                raise files.UnreadableError(
                    f"{self.path / entry.name} of the {self.kind} {self.id} can't be read "
                    f"({error.strerror})."
                ) from None
            raise self._damaged(entry, str(error.strerror)) from None
        if files.sha256(content) != entry.sha256:
            raise self._damaged(entry, "its checksum differs")
        return content

    @property
    def set_aside_hint(self) -> str:
        """The end of a message on damage: the command that sets the record aside."""
        results = self.path.parents[len(Path(self.id).parts)]
        return f"set it aside with `{with_results('jbench repair', results)}`"

    def _damaged(self, entry: FileEntry, reason: str) -> WorkError:
        return WorkError(
            f"{self.path / entry.name} of the {self.kind} {self.id} is damaged ({reason}); "
            f"restore it, or {self.set_aside_hint}."
        )
