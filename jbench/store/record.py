"""A record: its manifest and its files.

The manifest is the commit: readers ignore files that it does not list. A writer adds new files
beside the old ones, syncs them, and then replaces the manifest.
"""

import contextlib
from collections.abc import Collection, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
from pydantic import ValidationError

from jbench.errors import RequestError
from jbench.store import files, locks, parquet
from jbench.store.manifest import MANIFEST, FileEntry, Manifest, reason_of
from jbench.store.provenance import differences, provenance
from jbench.store.record_reader import RecordReader


class Record(RecordReader):
    """A dataset, an encoder, a run, an evaluation or an import: its manifest and its files."""

    def create(self, settings: Mapping[str, Any], made_on: Mapping[str, Any] | None = None) -> None:
        """Creates the record, or restarts an unfinished one without its data.

        Args:
            made_on: more provenance, such as that of `device_provenance`.

        Raises:
            RequestError: if the settings are invalid, or the directory is not writable.
            WorkError: if the disk is full or fails.
        """
        now = _now()
        try:
            manifest = Manifest(
                kind=self.kind,
                id=self.id,
                settings=dict(settings),
                provenance={**provenance(), **(made_on or {})},
                created=now,
                updated=now,
            )
        except ValidationError as error:
            reason = reason_of(error)
            raise RequestError(f"The {self.kind} {self.id} can't be saved ({reason}).") from None
        files.make_directory(self.path)
        self._commit(manifest)
        self.clean()

    def append(
        self,
        tables: Mapping[str, pa.Table],
        checkpoints: Mapping[str, bytes] | None = None,
        *,
        drop: Collection[str] = (),
        replace: Collection[str] = (),
    ) -> None:
        """Adds rows to tables and replaces checkpoints in one atomic commit.

        Args:
            checkpoints: content by role, a file name such as `checkpoint.safetensors`; the state
                needed to resume after these rows. It replaces the previous file of the role.
                `read_file` finds it by its role; `finish` removes it.
            drop: roles of checkpoints to remove.
            replace: tables whose existing rows are dropped.
        """
        checkpoints = checkpoints or {}
        added = [self._write_part(name, rows) for name, rows in tables.items() if rows.num_rows]
        added += [self._write_checkpoint(role, content) for role, content in checkpoints.items()]
        before, dropped = self.manifest.files, {*checkpoints, *drop}
        kept = [
            entry for entry in before if entry.role not in dropped and entry.table not in replace
        ]
        # The same rows are the same file.
        listed = {entry.name: entry for entry in (*kept, *added)}
        self._update(files=tuple(listed.values()))
        files.remove(self.path / entry.name for entry in before if entry.name not in listed)

    def resume(
        self, where: Mapping[str, Any], made_on: Mapping[str, str | None] | None = None
    ) -> dict[str, list[Any]]:
        """Records in the provenance that unfinished or failed work is resumed.

        Args:
            where: progress as JSON values; time and changes of provenance are added.
            made_on: more provenance, as in `create`.

        Returns:
            Changes of versions, processor and device: value at the start, and now.
        """
        original = self.manifest.provenance
        changed = differences(original, {**provenance(), **(made_on or {})})
        note = {"at": _now(), **where, "changed": changed}
        before = original.get("continued")
        continued = [*(before if isinstance(before, list) else []), note]
        self._update(
            status="unfinished", summary={}, provenance={**original, "continued": continued}
        )
        return changed

    def finish(
        self,
        summary: Mapping[str, Any],
        new_files: Mapping[str, bytes] | None = None,
        compact: bool = True,
        keep: Collection[str] = (),
    ) -> None:
        """Marks the record as finished and removes its checkpoints.

        Args:
            new_files: content of additional files by name.
            compact: whether to join each table into one file, which must fit in memory.
            keep: roles of checkpoints that are not removed.
        """
        files = (entry for entry in self.manifest.files if entry.table is None)
        kept = tuple(entry for entry in files if entry.role is None or entry.role in keep)
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

    def copy_from(self, source: "Record") -> None:
        """Copies a record of another results directory; call it while holding the lock.

        Raises:
            WorkError: if a file of the source is damaged, or the disk is full.
        """
        for entry in source.manifest.files:
            files.copy_atomic(source.path / entry.name, self.path / entry.name, entry.sha256)
        self._commit(source.manifest)
        self.clean()

    def clean(self) -> None:
        """Removes uncommitted files; call it while holding the lock. Errors are ignored."""
        with contextlib.suppress(OSError):
            files.remove(self.uncommitted())

    def fail(self, error: str, details: Mapping[str, Any] | None = None) -> None:
        """Marks the work as failed, by a sentence and details for the summary; keeps its data."""
        self._update(status="failed", summary={"error": error, **(details or {})})

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Locks the record during the block.

        Raises:
            WorkError: if another process holds the lock.
        """
        files.make_directory(self.path)
        with locks.hold(self.path, f"the {self.kind} {self.id}"):
            yield

    def uncommitted(self) -> list[Path]:
        """Returns the files that an interrupted writer left uncommitted.

        Raises:
            OSError: if the directory can't be listed.
        """
        return files.unlisted(self.path, {MANIFEST, *(e.name for e in self.manifest.files)})

    def _join(self, table: str) -> FileEntry:
        parts = self.parts(table)
        if len(parts) == 1:
            return parts[0]
        # Parts of an older version may lack a column, which becomes null.
        rows = pa.concat_tables([self.rows_of(part) for part in parts], promote_options="default")
        return self._write_part(table, rows)

    def _write_part(self, table: str, rows: pa.Table) -> FileEntry:
        content = parquet.to_bytes(rows)
        # The hash makes the name unique; the number shows the order.
        name = f"{table}-{len(self.parts(table)):05d}-{files.sha256(content)[:8]}.parquet"
        return self._write_file(name, content, table, rows.num_rows)

    def _write_checkpoint(self, role: str, content: bytes) -> FileEntry:
        # A new name: the previous file stays listed and intact until the commit.
        stem, suffix = Path(role).stem, Path(role).suffix
        name = f"{stem}-{files.sha256(content)[:8]}{suffix}"
        return self._write_file(name, content, role=role)

    def _write_file(
        self,
        name: str,
        content: bytes,
        table: str | None = None,
        rows: int = 0,
        role: str | None = None,
    ) -> FileEntry:
        entry = FileEntry(
            name=name,
            table=table,
            role=role,
            rows=rows,
            bytes=len(content),
            sha256=files.sha256(content),
        )
        files.write_atomic(self.path / name, content)
        return entry

    def _update(self, **changes: Any) -> None:
        self._commit(self.manifest.model_copy(update={"updated": _now(), **changes}))

    def _commit(self, manifest: Manifest) -> None:
        files.write_atomic(self.path / MANIFEST, manifest.to_bytes())
        self.manifest = manifest


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
