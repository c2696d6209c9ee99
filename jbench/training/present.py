"""Records whose code is not the present one, as `jbench verify` lists them.

Modules are found and read, but not imported: anyone may have recorded their names. Only a task
whose files are the recorded ones is made, to compare its robot.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from jbench import plugins
from jbench.errors import RequestError, WorkError
from jbench.store import Record
from jbench.store.code import (
    MODULES,
    changed_files,
    changed_since,
    code_of,
    have_changed,
    with_data_read,
)
from jbench.store.manifest import RecordKind
from jbench.store.provenance import mapping

_TASK_SETTING = {"dataset": "robot", "run": "task", "evaluation": "task"}
"""The setting that names the task, by kind of record."""


class OtherCode(NamedTuple):
    """A record whose code has changed, or is not at hand; `files` are the names of what changed."""

    kind: RecordKind
    id: str
    created: str
    files: tuple[str, ...]

    @property
    def difference(self) -> str:
        """A clause on what is not as it was when the record was made."""
        if not self.files:
            return "its code is not at hand"
        return f"{have_changed(self.files)} since then"


def other_code(records: Sequence[Record]) -> Iterator[OtherCode]:
    """Yields the records with users' code that is not the present one.

    Those of runs name the code of their encoder, too, if the encoder is among the records.
    """
    encoders = {record.id: record for record in records if record.kind == "encoder"}
    for record in records:
        recorded = code_of(record.manifest.provenance)
        if not recorded:
            continue
        now = _at_hand(record, encoders)
        files = changed_since(record, now)
        # Without its record, the kind of an encoder is not known.
        has_known_kind = str(record.settings.get("encoder")) in encoders
        is_missing = any(
            _is_missing(recorded, now, key)
            for key in MODULES
            if key != "encoder_sources" or has_known_kind
        )
        if not files and not is_missing:
            files = changed_files(recorded, _robot(record))
        if files or is_missing:
            created = record.manifest.created
            yield OtherCode(record.kind, record.id, created, tuple(files))


def _is_missing(recorded: Mapping[str, Any], now: Mapping[str, Any], key: str) -> bool:
    """Returns whether code was recorded, by a key of `MODULES`, and is not at hand."""
    keys = (key, MODULES[key])
    was_there = any(recorded.get(name) for name in keys)
    is_here = any(now.get(name) for name in keys)
    return was_there and not is_here


def _at_hand(record: Record, encoders: Mapping[str, Record]) -> dict[str, Any]:
    """Returns the checksums of the present code that a record names, as its provenance has them.

    Args:
        record: of any kind.
        encoders: by id.
    """
    # These import torch and MuJoCo, which records without users' code do not need.
    from jbench.agents.find import installed
    from jbench.policies.find import offered_policies
    from jbench.tasks import find

    settings = record.settings
    found = dict[str, Any]()
    task = str(settings.get(_TASK_SETTING.get(record.kind, "")))
    recorded = mapping(record.manifest.provenance.get("task_sources"))
    for key, value in find.files_at_hand(task, recorded).items():
        found[f"task_{key}"] = value

    if record.kind == "run":
        found |= plugins.files_at_hand(str(settings.get("algo")), installed())
        encoder = encoders.get(str(settings.get("encoder")))
        if encoder is not None:
            found |= {f"encoder_{key}": value for key, value in _kind_at_hand(encoder).items()}
    elif record.kind == "encoder":
        found |= _kind_at_hand(record)
    elif record.kind == "evaluation":
        found |= plugins.files_at_hand(str(settings.get("policy")), offered_policies())

    return found


def _kind_at_hand(encoder: Record) -> dict[str, Any]:
    """Returns the checksums of the present code of a kind, as an encoder's provenance has them."""
    from jbench.encoders.registry import offered_kinds  # imports torch

    found = plugins.files_at_hand(str(encoder.settings.get("kind")), offered_kinds())
    return with_data_read(found, encoder.manifest.provenance)


def _robot(record: Record) -> dict[str, Any]:
    """Returns the checksum of the robot of a task, whose files are the recorded ones."""
    if not record.manifest.provenance.get("task_compiled"):
        return {}
    if not record.manifest.provenance.get("task_sources"):
        return {}
    from jbench.tasks import find  # imports MuJoCo

    try:
        return find.task_provenance(str(record.settings.get(_TASK_SETTING[record.kind])))
    except (RequestError, WorkError):
        return {}
