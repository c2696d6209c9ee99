"""Whether the code behind a record is the present one.

A manifest's provenance holds the checksum of each file of users' code (`jbench/sources.py`), and of
a task's robot. Records of older versions hold less: they are compared by what they hold, and keys
that this version does not know refuse nothing.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from jbench.errors import RequestError
from jbench.settings.base import settings_hash
from jbench.store.provenance import last_note, mapping, package_versions
from jbench.store.record import Record
from jbench.wording import have, in_prose

Code = Mapping[str, Any]
"""Provenance of code, by the names of `PROVENANCE_OF_CODE`."""

MODULES = {
    "task_sources": "task_source_sha256",
    "sources": "source_sha256",
    "encoder_sources": "encoder_source_sha256",
}
"""Checksums by file, of the code of a task, of an algorithm, encoder kind or policy, and of a run's
encoder; and what older versions recorded instead: the checksum of the module's bytes."""

ROBOT = "task_compiled"
"""The checksum of the robot that MuJoCo has compiled."""

PROVENANCE_OF_CODE = (*MODULES, *MODULES.values(), ROBOT)
"""Keys of a manifest's provenance that are of users' code."""

ROBOT_NAME = "the robot's MuJoCo model"
ACCEPT = "--accept-changed-code"


class ChangedCodeError(RequestError):
    """The code behind a record is not the present one; `files` are the names of what changed."""

    def __init__(self, sentence: str, files: Sequence[str] = ()) -> None:
        """Says in a sentence which files have changed."""
        super().__init__(sentence)
        self.files = tuple(files)


def check_code(record: Record, now: Code) -> None:
    """Raises a ChangedCodeError, which names record, files and date, if the code has changed."""
    files = changed_since(record, now)
    if files:
        raise ChangedCodeError(
            f"{since_recorded(record, files)}; restore the code of that time, or type {ACCEPT} to "
            "go on with the present code.",
            files,
        )


def changed_since(record: Record, now: Code) -> list[str]:
    """Returns what has changed of the code behind a record; see `changed_files`.

    A run that went on with changed code, which was accepted, is compared with that.
    """
    made: Mapping[str, Any] = record.manifest.provenance
    accepted = record.settings.get("accepted")
    if accepted is None:
        return changed_files(made, now)
    if accepted == code_hash(now):
        return []

    code_of_last_note = mapping(last_note(made).get("code"))
    return changed_files({**made, **code_of_last_note}, now)


def since_recorded(record: Record, files: Sequence[str]) -> str:
    """Returns a clause that names a record, what has changed since it was recorded, and when."""
    return (
        f"The code has changed: {have_changed(files)} since the {record.kind} {record.id} was "
        f"recorded ({date_of(record)})"
    )


def have_changed(files: Sequence[str]) -> str:
    """Returns a clause such as `reward.py has changed`, with the names of all files."""
    return f"{in_prose(files, 'and')} {have(len(files))} changed"


def date_of(record: Record) -> str:
    """Returns when a record was begun, such as `2026-11-28 13:05 UTC`."""
    return short_date(record.manifest.created)


def short_date(created: object) -> str:
    """Returns the date of a manifest to the minute; an invalid one as it is."""
    try:
        return f"{datetime.fromisoformat(str(created)):%Y-%m-%d %H:%M} UTC"
    except ValueError:
        return str(created)


def changed_files(before: Code, now: Code) -> list[str]:
    """Returns the names of the files of users' code that differ; [] if none is known to.

    Args:
        before: the provenance of a record.
        now: provenance of the present code.
    """
    names = list[str]()
    for key, module in MODULES.items():
        recorded = mapping(before.get(key))
        present = mapping(now.get(key))
        if recorded and present:
            names += _different(recorded, present)
        elif _both(before, now, module) and before[module] != now[module]:
            names.append(next(iter(present), "the module"))

    # Another version of MuJoCo may compile other numbers from the same XML.
    if _both(before, now, ROBOT) and before[ROBOT] != now[ROBOT] and _same_mujoco(before):
        names.append(ROBOT_NAME)

    return names


def _different(recorded: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Returns the names of files whose checksums differ; of data that are gone, with a word."""
    every = sorted(recorded.keys() | present.keys())
    names = [name for name in every if recorded.get(name) != present.get(name)]
    if any(name.endswith(".py") for name in names):
        return names  # the code may name other files now
    return [name if name in present else f"{name} (not found)" for name in names]


def with_data_read(now: Code, before: Code) -> dict[str, Any]:
    """Returns provenance of an encoder's code in which data files that are gone are as recorded.

    The encoder has saved what its kind learned from them.

    Args:
        now: provenance of the present code.
        before: the provenance of the encoder's record.
    """
    files = mapping(now.get("sources"))
    gone = {
        name: checksum
        for name, checksum in mapping(before.get("sources")).items()
        if name not in files and not name.endswith(".py")
    }
    if not files or not gone:
        return dict(now)
    return {**now, "sources": {**files, **gone}}


def is_known(code: Code) -> bool:
    """Returns whether provenance holds anything of users' code."""
    return any(code.get(key) for key in PROVENANCE_OF_CODE)


def code_of(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the part of a record's provenance that is of users' code."""
    return {key: provenance[key] for key in PROVENANCE_OF_CODE if provenance.get(key)}


def code_hash(code: Code) -> str:
    """Returns a checksum of all of the users' code."""
    return settings_hash(code_of(code))


def _both(before: Code, now: Code, key: str) -> bool:
    """Returns whether two provenances have the same checksum: only then can it be compared."""
    return isinstance(before.get(key), str) and isinstance(now.get(key), str)


def _same_mujoco(before: Code) -> bool:
    """Returns whether a record was made by the MuJoCo of today, or does not say by which."""
    recorded = mapping(before.get("packages")).get("mujoco")
    return recorded in (None, package_versions().get("mujoco"))
