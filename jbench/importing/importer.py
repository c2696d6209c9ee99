"""Reads all files of an import, then writes a record for each seed."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from jbench.errors import RequestError
from jbench.importing import columns, sb3, tensorboard
from jbench.importing.reader import Series
from jbench.importing.request import ImportedFile, ImportRequest, open_file
from jbench.names import ImportFormat
from jbench.settings.base import validated
from jbench.settings.records import ImportSettings
from jbench.store import Results, schema
from jbench.store.manifest import check_settings
from jbench.store.parquet import to_table


class _Format(NamedTuple):
    """How files of a format are read.

    Attributes:
        read: returns the learning curves of a file.
        join: returns the points of a seed's several files; None if it may have only one.
        order: column whose first value orders the files.
    """

    read: Callable[[ImportedFile, ImportRequest], list[Series]]
    join: Callable[[Sequence[Series]], pd.DataFrame] | None = None
    order: str = ""


_FORMATS: dict[ImportFormat, _Format] = {
    "sb3-monitor": _Format(sb3.read_monitor, sb3.join_environments, "wall_time"),
    "sb3-evaluations": _Format(sb3.read_evaluations),
    "tensorboard": _Format(tensorboard.read, tensorboard.join_trainings, "control_steps"),
    "wandb-csv": _Format(columns.read_wandb),
    "csv": _Format(columns.read_csv),
}


class Imported(NamedTuple):
    """A learning curve in the results.

    Attributes:
        id: of its record.
        points: number of points; evaluations of several episodes count once.
        control_steps: control steps of the last point.
        is_new: False if the same files were imported before.
    """

    id: str
    seed: int
    points: int
    control_steps: int
    is_new: bool


def import_curves(
    results: Results, paths: Sequence[Path], request: ImportRequest
) -> list[Imported]:
    """Imports learning curves; nothing is written unless all files can be read.

    Returns:
        The curve of each seed.

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
    read = _FORMATS[request.format].read
    by_seed: dict[int, list[Series]] = {}
    for file in by_hash.values():
        for series in read(file, request):
            by_seed.setdefault(series.seed, []).append(series)
    curves = [_curve(parts, request) for _, parts in sorted(by_seed.items())]
    return [_write(results, *curve) for curve in curves]


def _curve(
    parts: Sequence[Series], request: ImportRequest
) -> tuple[ImportSettings, pd.DataFrame, list[str]]:
    """Returns settings and points of the learning curve of a seed, and the names of its files.

    Raises:
        RequestError: if its parts are not parts of one curve, or a name can't be recorded.
    """
    how = _FORMATS[request.format]
    if how.join is not None:
        # The id must not depend on the order in which the files are named.
        parts = sorted(parts, key=lambda part: (part.points[how.order].iloc[0], part.file.sha256))
    elif len(parts) > 1:
        where = " and ".join(dict.fromkeys(str(part.file.path) for part in parts))
        raise RequestError(
            f"{where}: seed {parts[0].seed} has {len(parts)} learning curves; change --seed-from, "
            "or import one of them."
        )
    first = parts[0]
    points = first.points if how.join is None else how.join(parts)
    settings = validated(
        ImportSettings,
        "the import",
        task=request.task,
        algo=request.algo,
        representation=request.representation,
        seed=first.seed,
        format=request.format,
        returns=first.returns,
        files=[part.file.sha256 for part in parts],
        columns=dict(first.columns),
    )
    try:
        check_settings(settings.values)
    except ValueError as error:
        raise RequestError(f"{first.file.path}: {error}; rename the column in the file.") from None
    return settings, points, [_printable(str(part.file.path)) for part in parts]


def _printable(name: str) -> str:
    """Returns the name of a file as a manifest allows it."""
    return "".join(c if c.isprintable() else "_" for c in name)


def _write(
    results: Results, settings: ImportSettings, points: pd.DataFrame, names: list[str]
) -> Imported:
    rows = points.reset_index(drop=True)
    if "wall_time" in rows:
        rows["wall_time"] -= rows["wall_time"].min()
    rows["import"] = settings.id
    if "point" not in rows:
        rows["point"] = rows.index
    if "episode" not in rows:
        rows["episode"] = 0
    last = {
        "points": int(rows["point"].iloc[-1]) + 1,
        "control_steps": int(rows["control_steps"].iloc[-1]),
    }
    with results.locked("import", settings.id) as existing:
        is_new = existing is None or existing.status != "finished"
        if is_new:
            record = results.create("import", settings.id, settings.values, {"files": names})
            record.append({"import_points": to_table(rows, schema.IMPORT_POINTS)})
            record.finish(last)
    return Imported(settings.id, settings.seed, **last, is_new=is_new)
