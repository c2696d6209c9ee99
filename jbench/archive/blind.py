"""Records without names: of people, machines, places, packages and modules.

Provenance is cut down to what rounds numbers, and the checksum of a run's encoder. A name of code
that is not jbench's, Gymnasium's or dm_control's becomes a number (`agent-1`), as does a version or
checksum of this code (`code-1`): in settings, in ids, in the rows that repeat an id, and in files
that repeat a kind. Ids, names of files and checksums are then made again. Records that have no such
name keep theirs.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field
from string import ascii_lowercase
from typing import Any, Protocol

import pyarrow as pa

from jbench.archive.words import found_in, may_name_something
from jbench.encoders.registry import short_name
from jbench.names import POLICIES, TASKS
from jbench.representation_names import ENCODER_KINDS
from jbench.settings.algorithms import SETTINGS
from jbench.settings.base import in_id, settings_hash
from jbench.settings.records import EXTERNAL, JITTERBUG
from jbench.settings.specs import CODE_CHECKSUMS
from jbench.store import Record, record_files
from jbench.store.manifest import FileEntry, Manifest
from jbench.store.weights import ENCODER_WEIGHTS
from jbench.task_specs import SUITE
from jbench.tasks.gym_registry import is_of_gymnasium

_ROUNDING = ("jbench", "python", "processor", "cores", "threads", "device", "gpu", "cuda", "driver")
_KEPT = (*_ROUNDING, ENCODER_WEIGHTS)
"""What of a record's provenance stays, with the versions in `packages`."""

_CODE_OF_RECORD = ("code", "sources", "accepted")
"""Settings that identify code: by its package and version, or by a checksum of its files."""

LEFT_OUT = "left-out"
"""Stands for a text that may name somebody or something."""

_PATH = re.compile(r"/|~|\\\\|[A-Za-z]:[\\/]|file:")
"""How the path of a file begins, also on Windows."""

_ID_COLUMNS = ("run", "encoder", "dataset", "evaluation_id")


class Form(Protocol):
    """The form in which records are written to an archive: with names or without."""

    @property
    def words(self) -> Set[str]:
        """Words that must not be in the archive."""

    def learn(self, records: Iterable[Record]) -> None:
        """Finds names in the settings of records, before any is written."""

    def settings(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the settings of a record in this form."""

    def id(self, record: Record) -> str:
        """Returns the id of a record in this form."""

    def manifest(self, record: Record, files: tuple[FileEntry, ...]) -> Manifest:
        """Returns the manifest of a record in this form, with these files."""

    def content(self, record: Record, entry: FileEntry, content: bytes) -> bytes:
        """Returns the content of a file of a record in this form."""


class Verbatim:
    """A `Form` that leaves records as they are."""

    words: Set[str] = frozenset()

    def learn(self, records: Iterable[Record]) -> None:
        """Finds nothing."""

    def settings(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the same settings."""
        return dict(settings)

    def id(self, record: Record) -> str:
        """Returns the same id."""
        return record.id

    def manifest(self, record: Record, files: tuple[FileEntry, ...]) -> Manifest:
        """Returns the manifest with these files."""
        return record.manifest.model_copy(update={"files": files})

    def content(self, record: Record, entry: FileEntry, content: bytes) -> bytes:
        """Returns the same content."""
        return content


@dataclass
class Blinder:
    """A `Form` that replaces names, the same name always by the same number.

    `words` are those of this machine, and those that were replaced.
    """

    words: set[str] = field(default_factory=set)
    _counts: Counter[str] = field(default_factory=Counter)  # of numbered names, by noun
    _numbers: dict[str, dict[str, str]] = field(default_factory=dict)
    _ids: dict[str, str] = field(default_factory=dict)

    def learn(self, records: Iterable[Record]) -> None:
        """Finds the names of code in the settings of records, before any is written."""
        for record in records:
            settings = record.settings
            engine = settings.get("engine")
            if record.kind == "run" and engine != EXTERNAL and settings.get("algo") not in SETTINGS:
                self._number("agent", settings.get("algo"))
            if record.kind == "encoder" and settings.get("kind") not in ENCODER_KINDS:
                self._number("kind", settings.get("kind"))
            if record.kind == "evaluation":
                policy = str(settings.get("policy"))
                is_run = "/" in policy and not policy.endswith(".zip")
                if not is_run and policy.partition(":")[0] not in POLICIES:
                    self._number("policy", policy)

            for task in (settings.get("task"), settings.get("robot")):
                if isinstance(task, str) and not _is_public(task):
                    self._number("task", task)
            self._number("package", settings.get("package"))

            for name in _CODE_OF_RECORD:
                self._number("code", settings.get(name))
            for name in CODE_CHECKSUMS:
                self._number("code", (settings.get("specs") or {}).get(name))

    def settings(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Returns settings with every name replaced."""
        return {name: self._value(value) for name, value in settings.items()}

    def id(self, record: Record) -> str:
        """Returns the id of a record of these settings, which is the old one if nothing changed."""
        settings = self.settings(record.settings)
        if settings == record.settings:
            return record.id
        # The name of a task may have a slash.
        *parts, last = self._numbered_in_ids(record.id).split("/")
        seed = last.rpartition("-")[0]
        new = "/".join([*map(self._text, parts), f"{seed}-{settings_hash(settings)}"])
        self._ids[record.id] = new
        return new

    def manifest(self, record: Record, files: tuple[FileEntry, ...]) -> Manifest:
        """Returns the manifest of a record without names."""
        made = record.manifest.provenance
        packages = made.get("packages")
        provenance = {name: made[name] for name in _KEPT if name in made}
        if isinstance(packages, Mapping):
            provenance["packages"] = dict(packages)

        fields = record.manifest.model_dump()
        fields["id"] = self.id(record)
        fields["settings"] = self.settings(record.settings)
        fields["summary"] = _without_texts(record.manifest.summary)
        fields["provenance"] = provenance
        fields["files"] = files
        return Manifest(**fields)

    def content(self, record: Record, entry: FileEntry, content: bytes) -> bytes:
        """Returns the content of a file of a record without names; most files have none."""
        if entry.table is not None:
            return self._rows(record, entry, content)
        if entry.name.endswith(".json"):
            text = json.loads(content)
            return json.dumps(self._value(text), indent=1).encode()
        return content

    def _rows(self, record: Record, entry: FileEntry, content: bytes) -> bytes:
        """Returns the content of a table's file with the numbers of ids in place of their names."""
        if not self._ids:
            return content

        rows = record.read_part(entry)
        changed = rows
        for name in rows.column_names:
            if name in _ID_COLUMNS or name == record.kind:
                values = [self._ids.get(value, value) for value in rows[name].to_pylist()]
                column = pa.array(values, rows.schema.field(name).type)
                at = rows.schema.get_field_index(name)
                changed = changed.set_column(at, rows.schema.field(name), column)

        if changed.equals(rows):
            return content
        return record_files.to_bytes(changed)

    def _number(self, noun: str, name: object) -> None:
        """Gives the name of such a thing a number, or letters, so that the archive lacks it."""
        if not isinstance(name, str):
            return

        known = self._numbers.setdefault(noun, {})
        if name in known:
            return

        self._counts[noun] += 1
        number = str(self._counts[noun])
        if noun == "kind":  # which has no digits at its end
            number = _in_letters(self._counts[noun])

        known[name] = f"{noun}-{number}"
        self.words.update((name, in_id(name)))
        parts = re.split(r"[:./]", name.partition(",")[0])
        self.words.update(part for part in parts if may_name_something(part))
        if noun == "kind":
            short = short_name(name)
            self.words.add(short)
            known.setdefault(short, known[name])

    def _value(self, value: Any) -> Any:
        """Returns a value of JSON without names, whatever it is nested in."""
        if isinstance(value, Mapping):
            return {name: self._value(item) for name, item in value.items()}
        if isinstance(value, list | tuple):
            return [self._value(item) for item in value]
        if isinstance(value, str):
            return self._text(value)
        return value

    def _text(self, text: str) -> str:
        """Returns a text without names: with numbers, or left out if it still says something."""
        if text in self._ids:
            return self._ids[text]

        for old, new in self._ids.items():
            text = text.replace(old.replace("/", "."), new.replace("/", "."))

        for noun, names in self._numbers.items():
            for name, number in names.items():
                if text in (name, in_id(name)):
                    return number
                if noun == "kind" and re.fullmatch(rf"{re.escape(name)}\d+.*", text):
                    return number + text.removeprefix(name)

        text = self._numbered_in_ids(text)
        if self._has_a_word(text):
            return LEFT_OUT
        return text

    def _numbered_in_ids(self, text: str) -> str:
        """Returns a text in which names that an id begins with, or a part of one, are numbers."""
        numbers = dict[str, str]()
        for names in self._numbers.values():
            numbers |= {in_id(name): number for name, number in names.items()}

        for name in sorted(numbers, key=len, reverse=True):
            text = re.sub(rf"(?<![\w.-]){re.escape(name)}/", f"{numbers[name]}/", text)
        return text

    def _has_a_word(self, text: str) -> bool:
        """Returns whether a text has a word that tells who made it, or is the path of a file."""
        return any(found_in(self.words, text)) or _PATH.match(text) is not None


def _is_public(task: str) -> bool:
    """Returns whether a task is jbench's, dm_control's or Gymnasium's own, which names nobody."""
    return task in (*TASKS, JITTERBUG) or task.startswith(SUITE) or is_of_gymnasium(task)


def _in_letters(number: int) -> str:
    """Returns a number from 1 on as the columns of a spreadsheet are numbered: a to z, aa, ab."""
    letters = ""
    while number:
        number, letter = divmod(number - 1, len(ascii_lowercase))
        letters = ascii_lowercase[letter] + letters
    return letters


def _without_texts(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a summary with its numbers; texts, such as errors, may name a place."""
    kept: dict[str, Any] = {}
    for name, value in summary.items():
        if isinstance(value, Mapping):
            kept[name] = {key: item for key, item in value.items() if _is_plain(key, item)}
        elif isinstance(value, str) and name != "device":
            kept[name] = LEFT_OUT
        else:
            kept[name] = value

    return kept


def _is_plain(name: str, value: Any) -> bool:
    """Returns whether a part of a summary names no place; `what` is one of jbench's own words."""
    return name == "what" or not isinstance(value, str)
