"""Files `evaluations.npz` of stable-baselines3's `EvalCallback`."""

import io
import zipfile
import zlib

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile, ImportRequest
from jbench.importing.series import Series, check_points

_ARRAYS = ("timesteps", "results", "ep_lengths")
_UNREADABLE = (
    *(ValueError, TypeError, AttributeError, OSError, EOFError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)


def read(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of all evaluations.

    Raises:
        RequestError: if it is not a whole file of an `EvalCallback`.
    """
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
    points = pd.DataFrame(
        {
            "point": np.repeat(np.arange(count), episodes),
            "control_steps": np.repeat(steps, episodes),
            "episode": np.tile(np.arange(episodes), count),
            "episode_return": returns.ravel(),
            "length": lengths.ravel(),
        }
    )
    check_points(points, file, lambda row: f"evaluation {row // episodes + 1}")
    return [Series(file, request.seed_in(str(file.path), "the path"), "evaluation", points, {})]
