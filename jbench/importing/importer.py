"""Reads all files of an import, then writes a record for each seed."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing import binary_files, csv_files
from jbench.importing.request import MAX_STEPS, ImportedFile, ImportRequest, Series, open_file
from jbench.names import EPISODE_STEPS, ImportFormat
from jbench.settings.base import validated
from jbench.settings.records import ImportSettings
from jbench.store import Results, schema
from jbench.store.listed import to_table
from jbench.store.manifest import check_settings

_READERS: dict[ImportFormat, Callable[[ImportedFile, ImportRequest], list[Series]]] = {
    "sb3-monitor": csv_files.read_monitor,
    "sb3-evaluations": binary_files.read_evaluations,
    "tensorboard": binary_files.read_events,
    "wandb-csv": csv_files.read_wandb,
    "csv": csv_files.read_csv,
}

_ORDER: dict[ImportFormat, str] = {"sb3-monitor": "wall_time", "tensorboard": "control_steps"}
"""Formats of which a seed may have several files, and the column whose first value orders them."""

_ROUNDING = 0.01  # of rewards that were summed in single precision
_MAX = {"control_steps": MAX_STEPS, "length": (1 << 31) - 1}  # the column of lengths is int32


class Imported(NamedTuple):
    """A learning curve in the results."""

    id: str  # of its record
    seed: int
    points: int  # evaluations of several episodes count once
    control_steps: int  # of the last point
    is_new: bool  # else the same files were imported before


def import_curves(
    results: Results, paths: Sequence[Path], request: ImportRequest
) -> list[Imported]:
    """Imports the learning curve of each seed; nothing is written unless all files can be read.

    Raises:
        RequestError: if a file can't be read, is cut off, empty, or not of the format, or a seed
            has several files of which only one can be its learning curve.
        WorkError: if the disk is full or fails.
    """
    if not paths:
        raise RequestError("No file is named; type the files to import.")
    by_hash: dict[str, ImportedFile] = {}
    for path in paths:
        file = open_file(path)
        if file.sha256 in by_hash:
            same = by_hash[file.sha256].path
            raise RequestError(f"{same} and {path} have the same content; name one of them.")
        by_hash[file.sha256] = file
    by_seed: dict[int, list[Series]] = {}
    for file in by_hash.values():
        for series in _READERS[request.format](file, request):
            _check_points(series.points, file)
            by_seed.setdefault(series.seed, []).append(series)
    curves = [_curve(parts, request) for _, parts in sorted(by_seed.items())]
    return [_write(results, *curve) for curve in curves]


def _check_points(points: pd.DataFrame, file: ImportedFile) -> None:
    """Raises a RequestError if returns, control steps or lengths can't be those of a task."""

    def refusal(row: int, reason: str) -> RequestError:
        return RequestError(f"{file.path}, {points.index.name} {points.index[row]}: {reason}")

    if points.empty:
        raise RequestError(f"{file.path} has no episode; leave the file out.")
    returns = points["episode_return"].to_numpy(np.float64)
    bad = np.flatnonzero(~((returns >= -_ROUNDING) & (returns <= EPISODE_STEPS + _ROUNDING)))
    if len(bad):
        raise refusal(
            bad[0],
            f"the return is {returns[bad[0]]:g}, but that of an episode is from 0 to "
            f"{EPISODE_STEPS}; import returns of the task's own rewards, not scaled ones or those "
            "of another environment.",
        )
    for name in _MAX.keys() & points.columns:
        counts = points[name].to_numpy(np.float64)
        bad = np.flatnonzero(~((counts >= 0) & (counts % 1 == 0) & (counts <= _MAX[name])))
        if len(bad):
            raise refusal(bad[0], f"{counts[bad[0]]:g} is no number of control steps.")
    steps = points["control_steps"].to_numpy(np.float64)
    back = np.flatnonzero(np.diff(steps) < 0)
    if len(back):
        after = back[0] + 1
        raise refusal(
            after,
            f"the control steps go back from {steps[back[0]]:,.0f} to {steps[after]:,.0f}, so "
            "there is more than one training in the file; split it.",
        )


def _curve(
    parts: Sequence[Series], request: ImportRequest
) -> tuple[ImportSettings, pd.DataFrame, list[str]]:
    order = _ORDER.get(request.format)
    if order is not None:
        # The id must not depend on the order in which the files are named.
        parts = sorted(parts, key=lambda part: (part.points[order].iloc[0], part.file.sha256))
    elif len(parts) > 1:
        where = " and ".join(dict.fromkeys(str(part.file.path) for part in parts))
        raise RequestError(
            f"{where}: seed {parts[0].seed} has {len(parts)} learning curves; change --seed-from, "
            "or import one of them."
        )
    first = parts[0]
    labels = ("task", "algo", "representation", "format")
    fields = {name: getattr(request, name) for name in labels}
    fields |= {"seed": first.seed, "returns": first.returns, "columns": dict(first.columns)}
    hashes = [part.file.sha256 for part in parts]
    settings = validated(ImportSettings, "the import", files=hashes, **fields)
    try:
        check_settings(settings.values)
    except ValueError as error:
        raise RequestError(f"{first.file.path}: {error}; rename the column in the file.") from None
    names = (str(part.file.path) for part in parts)
    printable = ["".join(c if c.isprintable() else "_" for c in name) for name in names]
    return settings, _joined(parts, order), printable


def _joined(parts: Sequence[Series], order: str | None) -> pd.DataFrame:
    """Returns the points of a seed's files: several environments', or of a continued training."""
    points = pd.concat([part.points for part in parts], ignore_index=True)
    if order == "wall_time":  # the order in which episodes ended
        points = points.sort_values("wall_time", kind="stable", ignore_index=True)
        return points.assign(control_steps=points["length"].cumsum())
    for earlier, later in itertools.pairwise(parts):
        first = later.points["control_steps"].iloc[0]
        if first <= earlier.points["control_steps"].iloc[-1]:
            raise RequestError(
                f"{earlier.file.path} and {later.file.path} are both of seed {later.seed} and both "
                f"have values at {first:,.0f} control steps: they are two trainings; import one of "
                "them."
            )
    return points


def _write(
    results: Results, settings: ImportSettings, rows: pd.DataFrame, names: list[str]
) -> Imported:
    if "wall_time" in rows:
        rows["wall_time"] -= rows["wall_time"].min()
    if "point" not in rows:
        rows = rows.assign(point=rows.index, episode=0)
    rows["import"] = settings.id
    points, steps = rows[["point", "control_steps"]].iloc[-1]
    last = {"points": int(points) + 1, "control_steps": int(steps)}
    with results.locked("import", settings.id) as existing:
        is_new = existing is None or existing.status != "finished"
        if is_new:
            record = results.create("import", settings.id, settings.values, {"files": names})
            record.append({"import_points": to_table(rows, schema.TABLES["import_points"])})
            record.finish(last)
    return Imported(settings.id, settings.seed, **last, is_new=is_new)
