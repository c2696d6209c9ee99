"""Merging results directories: intact records are copied; the sources are not changed.

A record is committed as usual, so an interrupted merge can be repeated.
"""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Literal, NamedTuple

import pyarrow as pa

from jbench.errors import RequestError, WorkError
from jbench.names import POLICY_FILES
from jbench.store import files, record_files, schema
from jbench.store.database import Results
from jbench.store.files import NoRoomError
from jbench.store.folder import Folder
from jbench.store.manifest import ID, KINDS, MANIFEST, RecordKind
from jbench.store.quarantine import Quarantine
from jbench.store.record import Record
from jbench.store.rows import has_policy
from jbench.store.verify import ShowProgress, examine, no_progress
from jbench.store.weights import has_other_encoder
from jbench.wording import in_prose

MergeOutcome = Literal["copied", "replaced", "same", "kept", "refused"]
"""Outcome for a record: copied; replaced an unfinished one, which was set aside; the same except
for times; kept because the existing record is more complete; or refused."""


class Merged(NamedTuple):
    """Outcome for a record of a source, by kind and id, and the sentence that refuses it."""

    record: str
    outcome: MergeOutcome
    reason: str = ""


def merge(
    results: Results, sources: Sequence[Results], progress: ShowProgress = no_progress
) -> list[Merged]:
    """Merges the sources, which are only read, into the results.

    What was made of a record that is refused, since another one of its id is there, is refused,
    too: here it would count as made of the other one.

    Raises a RequestError if a source contains no results, or is the destination, and a NoRoomError
    if the disk is full, which ends the merge.
    """
    for source in sources:
        root = source.path
        kinds = [f"{kind}s" for kind in KINDS]
        if not any((root / kind).is_dir() for kind in kinds):
            named = in_prose(kinds)
            raise RequestError(f"{root} holds no results; name a directory with {named} in it.")
        if files.real(root) == files.real(results.path):
            raise RequestError(f"{root} is the results directory itself; name another.")

    folders = []
    for kind, source in product(KINDS, sources):  # dependencies first
        for folder in source.walk(kind):
            if MANIFEST in folder.names:  # also if it can't be read
                folders.append((source, folder))

    merged: list[Merged] = []
    refused = set[_Key]()
    quarantine = Quarantine(results)
    with progress(len(folders)) as show:
        for source, folder in folders:
            name = f"{folder.kind} {folder.id}"
            try:
                merged.append(Merged(name, _merged(results, source, folder, quarantine, refused)))
            except NoRoomError:
                raise  # no record is at fault, and none of the others has room
            except (WorkError, RequestError) as error:
                merged.append(Merged(name, "refused", str(error)))
                # A folder of a stranger may have a name that is not an id.
                is_here = bool(ID.fullmatch(folder.id)) and results.has(folder.kind, folder.id)
                if isinstance(error, _OriginError) or is_here:
                    refused.add((source, folder.kind, folder.id))

            show(len(merged))

    return merged


class _OriginError(WorkError):
    """A record was made of one that was refused."""


_Key = tuple[Results, RecordKind, str]
"""The directory, kind and id of a record."""


def _merged(
    results: Results,
    source: Results,
    folder: Folder,
    quarantine: Quarantine,
    refused: Collection[_Key],
) -> MergeOutcome:
    """Copies one record, or keeps the one that is there, and returns which.

    Raises a WorkError if it is damaged or conflicts with the one that is there, an _OriginError if
    it was made of one of those that were refused.
    """
    kind = folder.kind
    id = folder.id
    other, flaws = examine(source, kind, id)
    for flaw in flaws:
        if flaw.sort != "leftover":
            raise WorkError(str(flaw))
    if other is None:
        raise WorkError(f"{folder.path} has disappeared.")

    target = results.folder(kind, id)
    outcome: MergeOutcome = "copied"
    with results.locked(kind, id) as existing:
        if existing is not None:
            outcome = other.reading(partial(_choose, existing, other))
        if outcome in ("copied", "replaced"):
            origin = other.manifest.origin
            is_refused = origin is not None and (source, *origin) in refused
            if origin is not None and (is_refused or has_other_encoder(other, results)):
                raise _OriginError(
                    f"{other.path} was made with another {origin.kind} {origin.id} than that of "
                    f"{results.path}, so it is not copied: jbench report --compare compares two "
                    "directories."
                )
            if outcome == "replaced":
                quarantine.take_record(results.found(kind, id))
            other.reading(partial(other.copy_to, target))

    return outcome


def _choose(mine: Record, other: Record) -> MergeOutcome:
    """Returns the outcome for a record that exists already; raises a WorkError if they conflict."""
    is_finished = mine.is_finished
    if is_finished and not other.is_finished:
        return "kept"
    if other.is_finished and not is_finished:
        return "replaced"
    if mine.manifest.files == other.manifest.files:
        return "same"

    entries = (*mine.manifest.files, *other.manifest.files)
    # Paths follow from the evaluations; older versions did not record them.
    tables = sorted({entry.table for entry in entries if entry.table not in (None, "paths")})
    difference = next(filter(None, (_difference(mine, other, table) for table in tables)), None)
    more = [other.rows(table) - mine.rows(table) for table in tables]
    if difference is None and is_finished:
        difference = _other_files(mine, other)
        if difference is None and any(more):
            difference = "another number of rows"

    if difference is None:
        if is_finished:
            return _with_policy(mine, other)
        if not any(more):
            return "same"
        # Two states of the same work: the one with more rows is newer.
        if min(more) >= 0:
            return "replaced"
        if max(more) <= 0:
            return "kept"
        difference = "each has rows that the other has not"

    raise WorkError(
        f"{other.path} has the settings of {mine.path}, but other content ({difference}); neither "
        "is changed."
    )


def _other_files(mine: Record, other: Record) -> str | None:
    """Returns which files other than tables and states differ; None if none does."""
    contents = [
        {(e.name, e.sha256) for e in record.manifest.files if e.table is None and e.role is None}
        for record in (mine, other)
    ]
    names = {name for name, _ in contents[0] ^ contents[1]}
    if names == {*POLICY_FILES}:
        if not (has_policy(mine) and has_policy(other)):
            return None
        # Older versions wrote the same policy in another format.
        formats = {b'"network"' in record.read_file(POLICY_FILES[1]) for record in (mine, other)}
        if len(formats) > 1:
            return None

    if not names:
        return None
    return f"in {', '.join(sorted(names))}"


def _with_policy(mine: Record, other: Record) -> MergeOutcome:
    """Returns the outcome for equal rows, of which one copy may lack the policy."""
    if has_policy(mine) == has_policy(other):
        return "same"
    if has_policy(mine):
        return "kept"
    return "replaced"


def _difference(mine: Record, other: Record, table: str) -> str | None:
    """Returns where the common rows of a table differ, except for times, or None."""
    if mine.parts(table) == other.parts(table):
        return None

    for ours, theirs in _common_rows(mine, other, table):
        if set(ours.column_names) != set(theirs.column_names):
            return f"other columns of {table}"
        for name in ours.column_names:
            if name in schema.TIMES:
                continue
            # Equal values have equal bytes, also NaN, which equals nothing.
            left, right = (
                record_files.to_bytes(pa.table({name: rows[name].combine_chunks()}))
                for rows in (ours, theirs)
            )
            if left != right:
                return f"{name} of {table}"

    return None


def _common_rows(mine: Record, other: Record, table: str) -> Iterator[tuple[pa.Table, pa.Table]]:
    """Yields the rows that both have, piece by piece: a file of each is in memory at a time."""

    def read(record: Record) -> Iterator[pa.Table]:
        """Returns the rows of each file of a record."""
        return (record.read_part(e, schema.FILES.get(table)) for e in record.parts(table))

    ours = read(mine)
    theirs = read(other)
    left = next(ours, None)
    right = next(theirs, None)
    while left is not None and right is not None:
        count = min(len(left), len(right))
        yield left[:count], right[:count]
        left = left[count:] if len(left) > count else next(ours, None)
        right = right[count:] if len(right) > count else next(theirs, None)
