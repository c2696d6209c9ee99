"""The scalars of a TensorBoard file."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jbench.errors import RequestError
from jbench.importing.imported_file import ImportedFile

_FRAME = 16  # bytes of a record around its data: its length, and two checksums


class Scalar(NamedTuple):
    """A logged number."""

    step: int
    wall_time: float  # of the clock (s)
    value: float


class Events(NamedTuple):
    """The scalars of a file, by tag.

    A writer with `purge_step` marks a training that was resumed: from there on, earlier values are
    replaced, those of earlier files as well.
    """

    scalars: dict[str, list[Scalar]]
    resumed_at: float  # the first such step; infinite if there is none


def read_event_file(file: ImportedFile) -> Events:
    """Reads a file as TensorBoard does.

    Raises a RequestError if TensorBoard is not installed, the file is cut off or damaged, or a
    scalar is not one number.
    """
    try:
        from tensorboard.backend.event_processing.event_file_loader import RawEventFileLoader
        from tensorboard.compat.proto.event_pb2 import SessionLog
    except ImportError:
        raise RequestError(
            'TensorBoard is not installed; type pip install "jbench[tensorboard]".'
        ) from None

    scalars = dict[str, list[Scalar]]()
    plugins = dict[str, str]()
    resumed_at = np.inf
    for event in _events(RawEventFileLoader(str(file.path)).Load(), file):
        if event.HasField("session_log") and event.session_log.status == SessionLog.START:
            resumed_at = min(resumed_at, event.step)
            for tag, values in scalars.items():
                scalars[tag] = [scalar for scalar in values if scalar.step < event.step]

        for value in event.summary.value:
            # Only the first value of a tag says which plugin the tag belongs to.
            plugin = plugins.setdefault(value.tag, value.metadata.plugin_data.plugin_name)
            if plugin == "scalars":
                scalar = Scalar(event.step, event.wall_time, _number(value, file))
                scalars.setdefault(value.tag, []).append(scalar)

    return Events({tag: values for tag, values in scalars.items() if values}, resumed_at)


def _events(records: Iterable[bytes], file: ImportedFile) -> Iterator[Any]:
    """Yields the events of records, of whichever version; a RequestError if some are missing."""
    from tensorboard.compat.proto.event_pb2 import Event
    from tensorboard.data_compat import migrate_event

    end = 0
    for record in records:
        end += _FRAME + len(record)
        yield migrate_event(Event.FromString(record))

    # The loader stops at a damaged record without a message.
    if end != len(file.content):
        raise RequestError(
            f"{file.path} is cut off or damaged after {end:,} bytes, or no file of TensorBoard."
        )


def _number(value: Any, file: ImportedFile) -> float:
    """Returns the number of a scalar's event."""
    from tensorboard.util.tensor_util import make_ndarray

    try:
        return float(make_ndarray(value.tensor).item())
    except (TypeError, ValueError):
        raise RequestError(
            f"{file.path}: a value of {value.tag[:40]!r} is not one number."
        ) from None
