"""A results directory and its records.

    results/
      datasets/<id>/   encoders/<id>/   runs/<id>/
        manifest.json        what the record is, and which files belong to it
        <table>-<n>-<hash>.parquet, *.safetensors, *.json

The manifest is the commit: a file that it does not list does not exist for a reader. A writer puts
new files beside the old ones, forces them to the disk, and only then replaces the manifest.
"""

import contextlib
import fcntl
import io
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.errors import RequestError, WorkError
from jbench.store import files
from jbench.store.identity import check_id
from jbench.store.manifest import MANIFEST, FileEntry, Kind, Manifest, Status
from jbench.store.provenance import provenance


class Results:
    """A results directory."""

    def __init__(self, path: Path) -> None:
        """Opens a results directory, which need not exist yet.

        Raises:
            RequestError: if something else than a directory stands there.
        """
        if path.exists() and not path.is_dir():
            raise RequestError(f"{path} is a file; name a directory with --results.")
        self.path = path

    def create(self, kind: Kind, id: str, settings: Mapping[str, Any]) -> "Record":
        """Starts a record, or starts an unfinished one over: what it had is given up."""
        record = Record(self, kind, id)
        files.make_directory(record.path)
        now = _now()
        record._commit(
            Manifest(
                kind=kind,
                id=id,
                settings=dict(settings),
                provenance=provenance(),
                created=now,
                updated=now,
            )
        )
        files.remove_unlisted(record.path, {MANIFEST})
        return record

    def find(self, kind: Kind, id: str) -> "Record | None":
        """Returns the record of that id, or None.

        Raises:
            RequestError: if it is not an id.
            WorkError: if there is one, but its manifest can't be read.
        """
        record = Record(self, kind, id)
        return record if record._load() else None

    def scan(self, kind: Kind) -> tuple[list["Record"], list[str]]:
        """Returns all records of a kind, oldest first, and a sentence for each unreadable one."""
        records, problems = [], []
        root = self.path / f"{kind}s"
        for path in sorted(root.rglob(MANIFEST)):
            try:
                record = Record(self, kind, path.parent.relative_to(root).as_posix())
                if record._load():
                    records.append(record)
            except (RequestError, WorkError) as error:
                problems.append(str(error))
        return sorted(records, key=lambda record: (record.manifest.created, record.id)), problems


class Record:
    """A dataset, an encoder or a run: its manifest and its files."""

    manifest: Manifest

    def __init__(self, results: Results, kind: Kind, id: str) -> None:
        """Names a record; `Results.create` and `Results.find` give one with its manifest."""
        root = results.path / f"{kind}s"
        self.kind, self.id = kind, check_id(id)
        self.path = root / id
        if not self.path.resolve().is_relative_to(root.resolve()):
            raise WorkError(f"{self.path} leads out of the results directory; it is not read.")

    @property
    def status(self) -> Status:
        """Whether the work is unfinished, finished or failed."""
        return self.manifest.status

    @property
    def settings(self) -> dict[str, Any]:
        """What produced the record."""
        return self.manifest.settings

    def append(self, tables: Mapping[str, pa.Table]) -> None:
        """Adds rows to tables: all of them or, if anything fails, none."""
        added = [self._write_part(name, rows) for name, rows in tables.items() if rows.num_rows]
        self._update(files=(*self.manifest.files, *added))

    def rows(self, table: str) -> int:
        """Returns how many rows of a table are committed."""
        return sum(entry.rows for entry in self.parts(table))

    def read(self, table: str, schema: pa.Schema) -> pa.Table:
        """Returns all committed rows of a table, checked against the manifest.

        Raises:
            WorkError: if a file is missing, altered or of other columns; it names the file.
        """
        parts = [self.read_part(entry, schema) for entry in self.parts(table)]
        return pa.concat_tables([schema.empty_table(), *parts])

    def read_part(self, entry: FileEntry, schema: pa.Schema) -> pa.Table:
        """Returns the rows of one file, checked against the manifest; see `read`."""
        rows = self._rows_of(entry)
        try:
            return rows.select(schema.names).cast(schema)
        except (pa.ArrowException, KeyError) as error:
            raise self._damaged(entry, str(error).splitlines()[0]) from None

    def parts(self, table: str) -> list[FileEntry]:
        """Returns the committed files of a table, in the order in which they were written."""
        return [entry for entry in self.manifest.files if entry.table == table]

    def read_file(self, name: str) -> bytes:
        """Returns the content of a committed file that is not a table.

        Raises:
            WorkError: if there is none of that name, or it is not what was committed.
        """
        for entry in self.manifest.files:
            if entry.name == name:
                return self._checked(entry)
        raise WorkError(f"The {self.kind} {self.id} has no file {name}.")

    def finish(
        self,
        summary: Mapping[str, Any],
        new_files: Mapping[str, bytes] | None = None,
        compact: bool = True,
    ) -> None:
        """Ends a record.

        Args:
            summary: what came out, in short; kept in the manifest.
            new_files: content by file name, added to the record.
            compact: whether each table becomes one file; not for tables larger than memory.
        """
        kept = tuple(entry for entry in self.manifest.files if entry.table is None)
        tables = dict.fromkeys(entry.table for entry in self.manifest.files if entry.table)
        if compact:
            joined = tuple(self._join(table) for table in tables)
        else:
            joined = tuple(entry for entry in self.manifest.files if entry.table)
        added = tuple(
            self._write_file(name, content) for name, content in (new_files or {}).items()
        )
        self._update(status="finished", summary=dict(summary), files=kept + joined + added)
        self.clean()

    def clean(self) -> None:
        """Removes files that an interrupted writer left: call it only while holding the lock."""
        files.remove_unlisted(self.path, {MANIFEST, *(entry.name for entry in self.manifest.files)})

    def fail(self, error: str) -> None:
        """Marks the work as failed, keeping what it has."""
        self._update(status="failed", summary={"error": error})

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Holds the record for this process; the lock of a process that died is free.

        Raises:
            WorkError: if another process holds it.
        """
        files.make_directory(self.path)
        try:
            file = open(self.path / "lock", "a")  # noqa: SIM115 - closed below, after the yield
        except OSError as error:
            raise WorkError(f"{self.path / 'lock'} can't be opened ({error.strerror}).") from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise WorkError(
                    f"Another process is writing the {self.kind} {self.id}; wait for it or stop it."
                ) from None
            yield

    def _join(self, table: str) -> FileEntry:
        parts = self.parts(table)
        if len(parts) == 1:
            return parts[0]
        return self._write_part(
            table,
            pa.concat_tables([self._rows_of(part) for part in parts]),
        )

    def _write_part(self, table: str, rows: pa.Table) -> FileEntry:
        sink = io.BytesIO()
        pq.write_table(rows, sink, compression="zstd")
        content = sink.getvalue()
        # The content's hash in the name makes it unique; the number shows the order to people.
        name = f"{table}-{len(self.parts(table)):05d}-{files.sha256(content)[:8]}.parquet"
        return self._write_file(name, content, table, rows.num_rows)

    def _write_file(
        self, name: str, content: bytes, table: str | None = None, rows: int = 0
    ) -> FileEntry:
        entry = FileEntry(
            name=name, table=table, rows=rows, bytes=len(content), sha256=files.sha256(content)
        )
        files.write_atomic(self.path / name, content)
        return entry

    def _rows_of(self, entry: FileEntry) -> pa.Table:
        """Returns the rows of a file, with whatever columns it has."""
        content = self._checked(entry)
        try:
            # pyarrow 26 aborts processes that end soon after it has started threads of its own; of
            # its ways to read, only this one starts none.
            file = pq.ParquetFile(pa.BufferReader(content), pre_buffer=False)
            rows = file.read(use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise self._damaged(entry, str(error).splitlines()[0]) from None
        if rows.num_rows != entry.rows:
            raise self._damaged(entry, f"{rows.num_rows} rows, not {entry.rows}")
        return rows

    def _checked(self, entry: FileEntry) -> bytes:
        """Returns a file's content if it is what was committed."""
        path = self.path / entry.name
        try:
            if path.is_symlink():
                raise self._damaged(entry, "a link to another place")
            content = path.read_bytes()
        except OSError as error:
            raise self._damaged(entry, str(error.strerror)) from None
        if len(content) != entry.bytes:
            raise self._damaged(entry, f"{len(content)} bytes, not {entry.bytes}")
        if files.sha256(content) != entry.sha256:
            raise self._damaged(entry, "its checksum differs")
        return content

    def _damaged(self, entry: FileEntry, reason: str) -> WorkError:
        return WorkError(
            f"{self.path / entry.name} of the {self.kind} {self.id} is damaged ({reason}); "
            f"restore it, or delete {self.path} to make it anew."
        )

    def _update(self, **changes: Any) -> None:
        self._commit(self.manifest.model_copy(update={"updated": _now(), **changes}))

    def _commit(self, manifest: Manifest) -> None:
        files.write_atomic(self.path / MANIFEST, manifest.to_bytes())
        self.manifest = manifest

    def _load(self) -> bool:
        """Reads the manifest, if there is one."""
        path = self.path / MANIFEST
        if not path.exists():
            return False
        try:
            content = path.read_bytes()
        except OSError as error:
            raise WorkError(f"{path} can't be read ({error.strerror}).") from None
        self.manifest = Manifest.from_bytes(content, str(path))
        if (self.manifest.kind, self.manifest.id) != (self.kind, self.id):
            raise WorkError(
                f"{path} calls itself {self.manifest.kind} {self.manifest.id}; it is not read."
            )
        return True


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
