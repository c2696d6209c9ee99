"""A results directory and its records; `docs/database.md` describes the layout."""

import contextlib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from jbench.errors import RequestError, WorkError
from jbench.representation_names import shown_representation
from jbench.store import files
from jbench.store.code import date_of
from jbench.store.folder import Folder
from jbench.store.manifest import ID, MANIFEST, Json, Manifest, RecordKind
from jbench.store.record import Record
from jbench.typed_values import closest, question, shown_as
from jbench.wording import with_results

_MAX_SHOWN = 5  # ids in a message


class Results:
    """A results directory; messages call it by its name: the path, or `reference` if shipped."""

    def __init__(
        self,
        path: Path | str,
        name: Path | None = None,
        may_lack: Callable[[str], Collection[str]] = lambda id: (),
    ) -> None:
        """Opens a directory, which need not exist; raises a RequestError if it is a file.

        Args:
            path: the directory.
            name: what messages call it, by default the path.
            may_lack: takes the id of a record; returns the names of files that it may lack although
                its manifest lists them.
        """
        path = Path(path)
        try:
            is_file = path.exists() and not path.is_dir()
        except OSError as error:
            raise WorkError(f"{path} can't be read ({error.strerror}).") from None

        if is_file:
            raise RequestError(f"{path} is a file; name a directory with --results.")
        if path.is_symlink() and not path.exists():
            raise RequestError(
                f"{path} is a link to a place that does not exist; name a directory with --results."
            )

        self.path = path
        self.name = name or path
        self.may_lack = may_lack

    def folder(self, kind: RecordKind, id: str) -> Folder:
        """Returns a folder, which need not exist yet; raises a RequestError for an invalid id."""
        if not ID.fullmatch(id):  # it could lead out of the results directory
            raise RequestError(
                f"{id!r} is not an id; an id looks like face_direction/dae12/s00-1f9a2c4e."
            )
        return Folder(self.inside(f"{kind}s/{id}"), kind, id, may_lack=self.may_lack(id))

    def create(
        self, kind: RecordKind, id: str, settings: Json, made_on: Json | None = None
    ) -> Record:
        """Creates a record, with more provenance, or restarts an unfinished one; see `begin`."""
        return Record.begin(self.folder(kind, id), Manifest.new(kind, id, settings, made_on or {}))

    def find(self, kind: RecordKind, id: str) -> Record | None:
        """Returns the record of that id, or None; raises as `folder` and `Record.in_folder`."""
        return Record.in_folder(self.folder(kind, id))

    def has(self, kind: RecordKind, id: str) -> bool:
        """Returns whether there is a record of that id, be it damaged."""
        return (self.folder(kind, id).path / MANIFEST).exists()

    def find_readable(self, kind: RecordKind, id: str | None) -> Record | None:
        """Returns the record of that id; None also if it is damaged, and of the id None.

        For questions beside the work, such as whether code has changed: the work that needs the
        record meets the damage itself, and says so.
        """
        if id is None:
            return None
        try:
            return self.find(kind, id)
        except WorkError:
            return None

    def is_finished(self, kind: RecordKind, id: str) -> bool:
        """Returns whether there is a finished record of that id; False also if it is damaged."""
        record = self.find_readable(kind, id)
        return record is not None and record.is_finished

    def complete_id(self, kind: RecordKind, text: str) -> str:
        """Returns the id of the only record whose id begins with a text; else the text itself.

        The text may also be the path of the record's directory, or an id as a narrow table shows
        it, such as face_direction/ddpg/dae12…s00-1f9a2c4e; or it may have the representation as
        reports show it, such as planar for planar12. Raises a RequestError if it is no part of an
        id, or means several ids.
        """
        text = text.rstrip("/")
        if "…" in text:
            return self._whole_id(kind, text)

        root = files.real(self.path / f"{kind}s")
        typed = files.real(Path(text))
        if root in typed.parents:
            text = typed.relative_to(root).as_posix()
        if self.has(kind, text):
            return text

        found = self.scan(kind, text)[0]
        if not found:
            found = [each for each in self.scan(kind)[0] if _shown_id(each.id).startswith(text)]

        found.sort(key=lambda record: record.manifest.created)
        if len(found) > 1:
            some = ", ".join(f"{record.id} ({date_of(record)})" for record in found[:_MAX_SHOWN])
            if len(found) > _MAX_SHOWN:
                some += f" and {len(found) - _MAX_SHOWN} more"
            raise RequestError(f"Several {kind}s begin with {text}: {some}; type more of it.")

        if found:
            return found[0].id
        return text

    def _whole_id(self, kind: RecordKind, shortened: str) -> str:
        """Returns the id that a table shows shortened; a RequestError unless it is the only one."""
        ids = shown_as(shortened, sorted(record.id for record in self.scan(kind)[0]))
        if len(ids) == 1:
            return ids[0]

        problem = f"no {kind} is"
        if ids:
            problem = f"several {kind}s are: {', '.join(ids)}"
        raise RequestError(f"{shortened} is short for an id, and {problem}; type a whole id.")

    def no_run(self, id: str) -> RequestError:
        """Returns the error for an id of which there is no run; it names the most similar one."""
        close = closest(id, [record.id for record in self.scan("run")[0]])
        advice = f"{question(close)}{with_results('jbench runs', self.name)} lists them"
        return RequestError(f"There is no run {id} in {self.name}; {advice}.")

    @contextlib.contextmanager
    def locked(self, kind: RecordKind, id: str) -> Iterator[Record | None]:
        """Locks a record and yields it, or None if it does not exist yet; raises also as `find`.

        Files that an interrupted writer left uncommitted are removed. Raises a HeldError if another
        process holds the lock.
        """
        with self.folder(kind, id).lock():
            record = self.find(kind, id)
            if record is not None:
                record.clean()
            yield record

    def clean(self, kind: RecordKind, id: str) -> None:
        """Removes uncommitted files of a record, unless a process is writing it."""
        with contextlib.suppress(OSError, RequestError, WorkError):
            record = self.find(kind, id)
            if record is not None and record.uncommitted():
                with self.locked(kind, id):
                    pass  # it has removed them

    def scan(self, kind: RecordKind, beginning: str = "") -> tuple[list[Record], list[str]]:
        """Returns records whose id begins so, oldest first, and an error for each unreadable."""
        records = list[Record]()
        problems = list[str]()
        for folder in self.walk(kind, beginning.rpartition("/")[0]):
            if not folder.id.startswith(beginning):
                continue
            try:
                record = Record.in_folder(folder)
                if record is not None:
                    records.append(record)
            except files.RecordError as error:
                problems.append(str(error))

        return sorted(records, key=lambda record: (record.manifest.created, record.id)), problems

    def ids(self, kind: RecordKind) -> set[str]:
        """Returns the ids of the readable records of a kind."""
        return {record.id for record in self.scan(kind)[0]}

    def walk(self, kind: RecordKind, below: str = "") -> Iterator[Folder]:
        """Yields a folder of a kind and all folders below it, sorted; nothing if it does not exist.

        Each may have a record, which is not read yet. Symlinks are not followed. Iterative, since
        folders may be nested deeper than Python's stack.
        """
        top = self.path / f"{kind}s"
        stack = list[Path]()
        try:
            stack.append(self.inside(f"{kind}s/{below}"))
        except files.UnreadableError as error:
            yield Folder(error.path, kind, below, problem=error.problem)

        while stack:
            path = stack.pop()
            id = path.relative_to(top).as_posix()
            try:
                entries = files.entries(path)
            except FileNotFoundError:
                continue
            except OSError as error:
                yield Folder(path, kind, id, problem=f"can't be read ({error.strerror})")
                continue

            folders = {e.name for e in entries if e.is_dir(follow_symlinks=False)} - {MANIFEST}
            stack.extend(path / name for name in sorted(folders, reverse=True))
            names = [entry.name for entry in entries if entry.name not in folders]
            yield Folder(path, kind, id, names, may_lack=self.may_lack(id))

    def found(self, kind: RecordKind, id: str) -> Folder:
        """Returns one folder as `walk` does; an empty one if it does not exist."""
        return next(self.walk(kind, id), Folder(self.path / f"{kind}s" / id, kind, id, ()))

    def inside(self, name: str) -> Path:
        """Returns a path below the directory; an UnreadableError if a symlink leads out of it."""
        path = self.path / name
        if not files.real(path).is_relative_to(files.real(self.path)):
            raise files.UnreadableError(path, "leads out of the results directory; it is not used")
        return path


def _shown_id(id: str) -> str:
    """Returns an id with its representation as reports show it: planar for planar12."""
    return "/".join(shown_representation(part) for part in id.split("/"))
