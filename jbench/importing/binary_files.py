"""Binary files: `evaluations.npz` of stable-baselines3, and event files of TensorBoard.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import io
import struct
import zipfile
import zlib

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile, ImportRequest, Series

_ARRAYS = ("timesteps", "results", "ep_lengths")
_UNREADABLE = (
    *(ValueError, TypeError, AttributeError, OSError, EOFError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)

# Tags of training returns: of CleanRL, an episode each, and of stable-baselines3, means of 100.
_KNOWN_TAGS = ("charts/episodic_return", "rollout/ep_rew_mean")
_Scalars = dict[str, list[tuple[int, float, float]]]  # step, time (s) and value, by tag
_HEADER = struct.Struct("<QI")  # of a record: bytes of its data, and their checksum
_CHECKSUM = 4  # bytes after the data


def read_evaluations(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of all evaluations of an `EvalCallback`."""
    try:
        with np.load(io.BytesIO(file.content), allow_pickle=False) as arrays:
            steps, returns, lengths = (arrays[name].astype(np.float64) for name in _ARRAYS)
    except KeyError as error:
        raise RequestError(f"{file.path} is not of an EvalCallback: {error.args[0]}.") from None
    except _UNREADABLE as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise RequestError(
            f"{file.path} is cut off, or not an evaluations.npz ({reason})."
        ) from None
    if returns.ndim != 2 or steps.shape != returns.shape[:1] or lengths.shape != returns.shape:
        raise RequestError(
            f"{file.path} is not of an EvalCallback: its arrays have the shapes {steps.shape}, "
            f"{returns.shape} and {lengths.shape}."
        )
    count, episodes = returns.shape
    point = np.repeat(np.arange(count), episodes)
    columns = {"point": point, "control_steps": steps[point]}
    columns |= {"episode": np.tile(np.arange(episodes), count)}
    columns |= {"episode_return": returns.ravel(), "length": lengths.ravel()}
    points = pd.DataFrame(columns, pd.Index(point + 1, name="evaluation"))
    return [Series(file, request.seed_in(str(file.path), "the path"), "evaluation", points)]


def read_events(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the values of one tag; their time is that of the clock, in s."""
    scalars, tag = _scalars(file), request.tag
    if not scalars:
        raise RequestError(f"{file.path} has no scalars; leave the file out.")
    tags = [tag] if tag is not None else [name for name in _KNOWN_TAGS if name in scalars]
    if len(tags) != 1 or tags[0] not in scalars:
        reason = f"no tag {tag!r}" if tag is not None else "not exactly one known tag of returns"
        raise RequestError(
            f"{file.path} has {reason}; type --tag with one of {', '.join(sorted(scalars))}."
        )
    names = ["control_steps", "wall_time", "episode_return"]
    points = pd.DataFrame(scalars[tags[0]], columns=names).rename_axis("value")
    points.index += 1
    seed, kind = request.seed_in(str(file.path), "the path"), request.returns_kind(tags[0])
    return [Series(file, seed, kind, points, {"return": tags[0]})]


def _scalars(file: ImportedFile) -> _Scalars:
    try:
        from tensorboard.backend.event_processing.event_file_loader import EventFileLoader
        from tensorboard.util.tensor_util import make_ndarray
    except ImportError:
        raise RequestError(
            'TensorBoard is not installed; type pip install "jbench[tensorboard]".'
        ) from None
    count, scalars, plugins = 0, _Scalars(), dict[str, str]()
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
    if count == 0:
        raise RequestError(f"{file.path} is not an event file of TensorBoard.")
    # The reader stops at a damaged record without a message.
    if count != _records(file.content):
        raise RequestError(
            f"{file.path} is cut off or damaged after {count:,} records; copy it again."
        )
    return scalars


def _records(content: bytes) -> int | None:
    """Returns the number of records of an event file; None if it ends within one."""
    position = count = 0
    while position + _HEADER.size <= len(content):
        position += _HEADER.size + _HEADER.unpack_from(content, position)[0] + _CHECKSUM
        count += 1
    return count if position == len(content) else None
