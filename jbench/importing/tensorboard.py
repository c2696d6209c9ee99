"""Event files of TensorBoard, read by TensorBoard's own reader."""

import itertools
import struct
from collections.abc import Sequence

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.reader import Series, check_points
from jbench.importing.request import ImportedFile, ImportRequest

KNOWN_TAGS = ("charts/episodic_return", "rollout/ep_rew_mean")
"""Tags of training returns: of CleanRL, an episode each, and of stable-baselines3, means of 100."""

Scalars = dict[str, list[tuple[int, float, float]]]
"""Step, time (s) and value of each scalar, by tag."""

_HEADER = struct.Struct("<QI")  # of a record: bytes of its data, and their checksum
_CHECKSUM = 4  # bytes after the data


def read(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the values of one tag; their time is that of the clock, in s.

    Raises:
        RequestError: if it is not a whole event file, or lacks the tag.
    """
    scalars = _scalars(file)
    tag = _tag(file, scalars, request.tag)
    points = pd.DataFrame(scalars[tag], columns=["control_steps", "wall_time", "episode_return"])
    check_points(points, file, lambda row: f"value {row + 1} of {tag}")
    seed = request.seed_in(str(file.path), "the path")
    return [Series(file, seed, request.returns_kind(tag), points, {"return": tag})]


def join_trainings(parts: Sequence[Series]) -> pd.DataFrame:
    """Returns the points of a seed whose training was continued in further files.

    Args:
        parts: in the order of their first control steps.

    Raises:
        RequestError: if the files are not parts of one training.
    """
    for earlier, later in itertools.pairwise(parts):
        first = later.points["control_steps"].iloc[0]
        if first <= earlier.points["control_steps"].iloc[-1]:
            raise RequestError(
                f"{earlier.file.path} and {later.file.path} are both of seed {later.seed} and both "
                f"have values at {first:,.0f} control steps: they are two trainings; import one of "
                "them."
            )
    return pd.concat([part.points for part in parts], ignore_index=True)


def _tag(file: ImportedFile, scalars: Scalars, tag: str | None) -> str:
    """Returns the tag to read.

    Raises:
        RequestError: if it is not in the file, or none is named and not exactly one is known.
    """
    if not scalars:
        raise RequestError(f"{file.path} has no scalars; leave the file out.")
    tags = [tag] if tag is not None else [name for name in KNOWN_TAGS if name in scalars]
    if len(tags) == 1 and tags[0] in scalars:
        return tags[0]
    reason = f"no tag {tag!r}" if tag is not None else "not exactly one known tag of returns"
    raise RequestError(
        f"{file.path} has {reason}; type --tag with one of {', '.join(sorted(scalars))}."
    )


def _scalars(file: ImportedFile) -> Scalars:
    """Returns all scalars of an event file.

    Raises:
        RequestError: if TensorBoard is not installed, or the file is cut off or damaged.
    """
    try:
        from tensorboard.backend.event_processing.event_file_loader import EventFileLoader
        from tensorboard.util.tensor_util import make_ndarray
    except ImportError:
        raise RequestError(
            'TensorBoard is not installed; type pip install "jbench[tensorboard]".'
        ) from None
    count, scalars, plugins = 0, Scalars(), dict[str, str]()
    for event in EventFileLoader(str(file.path)).Load():
        count += 1
        for value in event.summary.value:
            # Only the first value of a tag says which plugin the tag belongs to.
            plugin = plugins.setdefault(value.tag, value.metadata.plugin_data.plugin_name)
            if plugin == "scalars":
                try:
                    number = float(make_ndarray(value.tensor).item())
                except (TypeError, ValueError):
                    raise RequestError(
                        f"{file.path}: a value of {value.tag[:40]!r} is not one number."
                    ) from None
                scalars.setdefault(value.tag, []).append((event.step, event.wall_time, number))
    # The reader stops at a damaged record without a message.
    records = _records(file.content)
    if records is None or count != records:
        if not count:
            raise RequestError(f"{file.path} is not an event file of TensorBoard.")
        raise RequestError(
            f"{file.path} is cut off or damaged after {count:,} records; copy it again."
        )
    return scalars


def _records(content: bytes) -> int | None:
    """Returns the number of records of an event file; None if it ends within one."""
    position = count = 0
    while position < len(content):
        if position + _HEADER.size > len(content):
            return None
        position += _HEADER.size + _HEADER.unpack_from(content, position)[0] + _CHECKSUM
        count += 1
    return count if position == len(content) else None
