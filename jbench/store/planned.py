"""Settings of new records whose code a user writes: as those of the records with the same code.

The checksum of users' code is part of an id, so that another code makes another record. Records of
older versions have no such checksum. As long as no file is known to have changed since such a
record, new ones have none either: so old runs are not trained again, and more seeds join them.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from pydantic import ValidationError

from jbench.settings.base import RecordSettings, Settings, canonical_json
from jbench.settings.specs import CODE_CHECKSUMS, MADE_BY_CODE
from jbench.store.code import ROBOT_NAME, Code, changed_files, date_of, have_changed
from jbench.store.record import Record
from jbench.wording import counted

_Settings = TypeVar("_Settings", bound=RecordSettings)


class Changed(NamedTuple):
    """A record whose settings are the planned ones, and what has changed of its code since."""

    record: Record
    files: tuple[str, ...]


class Planned(NamedTuple, Generic[_Settings]):
    """The settings of a new or existing record, and the records of changed code, oldest first."""

    settings: _Settings
    changed: list[Changed]


@dataclass(frozen=True)
class _SameCode:
    """Records that differ from each other in free settings only.

    Attributes:
        code: their checksums of code; see `_parts`.
        ids: of the records.
    """

    code: dict[str, Any]
    ids: set[str]


def planned(
    settings: _Settings, records: Iterable[Record], now: Code, free: Collection[str] = ()
) -> Planned[_Settings]:
    """Returns settings with the checksums of code that the records of the same code have.

    Args:
        settings: with the checksums of the present code.
        records: those of their kind, oldest first.
        now: provenance of the present code.
        free: names of settings in which records may differ and still be of one configuration.
    """
    groups = dict[str, _SameCode]()
    changed = list[Changed]()
    mine = _configuration(settings, free)
    for record in records:
        other = _read(settings, record)
        if other is None or _configuration(other, free) != mine or _accepted(record.settings):
            continue
        files = changed_files(record.manifest.provenance, now)
        if not files and _parts(other, MADE_BY_CODE) != _parts(settings, MADE_BY_CODE):
            files = [ROBOT_NAME]
        if files:
            changed.append(Changed(record, tuple(files)))
        code = _parts(other, CODE_CHECKSUMS)
        group = groups.setdefault(canonical_json(code), _SameCode(code, set()))
        group.ids.add(record.id)

    different = {entry.record.id for entry in changed}
    for group in reversed(groups.values()):
        candidate = _with_code(settings, group.code)
        is_own = candidate.id in group.ids and candidate.id not in different
        if is_own or group.ids.isdisjoint(different):
            return Planned(candidate, changed)

    return Planned(settings, changed)


def say_changed(plans: Iterable[Planned[Any]], existing: Collection[str]) -> Iterator[str]:
    """Yields `sentences` for those plans whose records do not exist yet."""
    changed = dict[str, Changed]()
    for plan in plans:
        if plan.settings.id not in existing:
            changed |= {entry.record.id: entry for entry in plan.changed}

    yield from sentences([*changed.values()])


def sentences(changed: Sequence[Changed]) -> Iterator[str]:
    """Yields a sentence for the records before each change, on what becomes of them."""
    by_files = dict[tuple[str, ...], list[Record]]()
    for entry in changed:
        by_files.setdefault(entry.files, []).append(entry.record)

    for files, records in by_files.items():
        last = records[-1]
        if len(records) == 1:
            which = f"the {last.kind} {last.id} was recorded ({date_of(last)})"
            stays = "it stays as it is"
        else:
            which = (
                f"{counted(len(records), last.kind)} were recorded, the last of them {last.id} "
                f"({date_of(last)})"
            )
            stays = "they stay as they are"

        yield f"{have_changed(files)} since {which}: what is made now has another id, and {stays}."


def _read(settings: _Settings, record: Record) -> _Settings | None:
    """Returns the settings of a record, or None if another version wrote them."""
    try:
        return type(settings).model_validate(record.settings)
    except ValidationError:  # of another version
        return None


def _accepted(values: Mapping[str, Any]) -> bool:
    """Returns whether a record was made with changed code that the user accepted."""
    return values.get("accepted") is not None


def _parts(settings: Settings, names: Collection[str]) -> dict[str, Any]:
    """Returns some of the settings and some of the task's specifications, by name."""
    specs = getattr(settings, "specs", None)
    return {
        "settings": {name: getattr(settings, name, None) for name in names},
        "specs": {name: getattr(specs, name, None) for name in names},
    }


def _with_code(settings: _Settings, code: Mapping[str, Mapping[str, Any]]) -> _Settings:
    """Returns settings with the checksums of code of another record."""
    changes = {
        n: value for n, value in code["settings"].items() if n in type(settings).model_fields
    }
    specs = getattr(settings, "specs", None)
    if specs:
        changes["specs"] = specs.model_copy(update=dict(code["specs"]))
    return settings.model_copy(update=changes)


def _configuration(settings: Settings, free: Collection[str]) -> str:
    """Returns a key that is equal for settings that differ only in code and in free settings."""
    values = {
        name: value
        for name, value in settings.values.items()
        if name not in (*free, *CODE_CHECKSUMS, "accepted")
    }
    specs = values.get("specs")
    if isinstance(specs, Mapping):
        left_out = (*CODE_CHECKSUMS, *MADE_BY_CODE)
        values["specs"] = {name: value for name, value in specs.items() if name not in left_out}

    return canonical_json(values)
