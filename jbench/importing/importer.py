"""Reads all files of an import, then writes a record for each seed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.foreign import refuse_other_format
from jbench.importing.imported_file import ImportedFile, open_file
from jbench.importing.readers import FORMATS, Series
from jbench.importing.request import ImportRequest
from jbench.importing.resumed import continued, in_order
from jbench.importing.tables import MAX_STEPS
from jbench.settings.records import ImportSettings, Labels
from jbench.store import Results, schema
from jbench.store.manifest import check_settings
from jbench.store.record_files import to_table
from jbench.task_specs import return_range
from jbench.wording import in_prose, printable

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
    by_hash: dict[str, ImportedFile] = {}
    for path in paths:
        file = open_file(path)
        refuse_other_format(path, file.content, request.format)
        same = by_hash.setdefault(file.sha256, file)
        if same is not file:
            raise RequestError(f"{same.path} and {path} have the same content; name one of them.")

    by_seed: dict[int, list[Series]] = {}
    for file in by_hash.values():
        for series in FORMATS[request.format].read(file, request):
            _check_points(series.points, file, request.task)
            _check_steps(series, request)
            by_seed.setdefault(series.seed, []).append(series)

    curves = [_curve(parts, request) for _, parts in sorted(by_seed.items())]
    return [_written(curve, results) for curve in curves]


@dataclass(frozen=True)
class _Curve:
    """The learning curve of a seed, before it is written."""

    settings: ImportSettings
    rows: pd.DataFrame  # of the table `import_points`
    files: list[str]  # names of the files that it was read from


def _written(curve: _Curve, results: Results) -> Imported:
    """Writes a record of a curve, unless there is one."""
    settings = curve.settings
    with results.locked("import", settings.id) as existing:
        is_new = existing is None or not existing.is_finished
        points, steps = curve.rows[["point", "control_steps"]].iloc[-1]
        last = {"points": int(points) + 1, "control_steps": int(steps)}
        if is_new:
            made_from = {"files": curve.files}
            record = results.create("import", settings.id, settings.values, made_from)
            table = to_table(curve.rows, schema.TABLES["import_points"])
            record.append({"import_points": table})
            record.finish(last)

    return Imported(settings.id, settings.seed, **last, is_new=is_new)


def _check_points(points: pd.DataFrame, file: ImportedFile, task: str) -> None:
    """Raises a RequestError if returns, control steps or lengths can't be those of a task."""

    def check(is_right: pd.Series, sentence: Callable[[pd.Series], str]) -> None:
        if not is_right.all():
            wrong = points.assign(before=points["control_steps"].shift())[~is_right].iloc[0]
            where = f"{file.path}, {points.index.name} {wrong.name}"
            raise RequestError(f"{where}: {sentence(wrong)}")

    if points.empty:
        raise RequestError(f"{file.path} has no episode; leave the file out.")

    check(
        pd.Series(np.isfinite(points["episode_return"]), points.index),
        lambda row: f"the return is {row['episode_return']:g}, which is not a finite number.",
    )
    possible = return_range(task)
    if possible is not None:
        lowest, highest = possible
        check(
            points["episode_return"].between(lowest - _ROUNDING, highest + _ROUNDING),
            lambda row: (
                f"the return is {row['episode_return']:g}, but that of an episode is from 0 to "
                f"{highest:g}; import returns of the task's own rewards, not scaled ones or those "
                "of another environment."
            ),
        )

    for name in points.columns.intersection([*_MAX]):
        is_count = points[name].between(0, _MAX[name]) & (points[name] % 1 == 0)
        check(is_count, partial(_sentence_on_count, name))

    check(
        ~(points["control_steps"].diff() < 0),
        lambda row: (
            f"the control steps go back from {row['before']:,.0f} to {row['control_steps']:,.0f}, "
            "so the file has more than one training, or is not sorted by steps; split or sort it."
        ),
    )


def _sentence_on_count(name: str, row: pd.Series) -> str:
    """Returns what is wrong with a row whose value in a column is no number of control steps."""
    return f"{row[name]:g} is no number of control steps."


def _check_steps(series: Series, request: ImportRequest) -> None:
    """Raises a RequestError if a curve has no steps, or two returns at one step."""
    points = series.points
    path = series.file.path
    count = len(points)
    if "point" in points:
        count = points["point"].nunique()

    if count > 1 and not points["control_steps"].any():
        raise RequestError(
            f"{path}: all control steps of seed {series.seed} are 0; export the curve with its "
            "control steps."
        )

    # Episodes of several environments may end at one step, which a log of training says.
    in_log = FORMATS[request.format].is_log or request.returns == "training"
    if "point" in points or (series.returns == "training" and in_log):
        return

    doubled = points[points["control_steps"].duplicated(keep=False)]
    if len(doubled):
        step = doubled["control_steps"].iloc[0]
        returns = doubled["episode_return"][doubled["control_steps"] == step]
        values = in_prose(map("{:g}".format, returns), "and")
        advice = "keep one of them"
        if series.returns == "training":
            advice += ", or type --returns training if they are episodes of several environments"

        raise RequestError(
            f"{path}: seed {series.seed} has the returns {values} at {step:,.0f} control steps; "
            f"{advice}."
        )


def _curve(parts: Sequence[Series], request: ImportRequest) -> _Curve:
    """Returns the curve of a seed, whose points are in one file or in several."""
    order = FORMATS[request.format].ordered_by
    if order is not None:
        # The id must not depend on the order in which the files are named.
        parts = in_order(parts, by=order)
    elif len(parts) > 1:
        where = " and ".join(dict.fromkeys(str(part.file.path) for part in parts))
        raise RequestError(
            f"{where}: seed {parts[0].seed} has {len(parts)} learning curves; change --seed-from, "
            "or import one of them."
        )

    first = parts[0]
    settings = ImportSettings(
        **request.model_dump(include={*Labels.model_fields, "format"}),
        seed=first.seed,
        returns=first.returns,
        files=[part.file.sha256 for part in parts],
        columns=dict(first.columns),
    )
    try:
        check_settings(settings.values)
    except ValueError as error:
        raise RequestError(f"{first.file.path}: {error}; rename the column in the file.") from None

    names = [printable(str(part.file.path), instead="_") for part in parts]
    points = _joined(parts, order)
    points["import"] = settings.id
    return _Curve(settings, points, names)


def _joined(parts: Sequence[Series], order: str | None) -> pd.DataFrame:
    """Returns the points of a seed's files: several environments', or of a continued training."""
    kept = [part.points for part in parts]
    if order == "control_steps":
        kept = continued(parts)

    points = pd.concat(kept, ignore_index=True)
    if order == "wall_time":  # the order in which episodes ended
        points = points.sort_values("wall_time", kind="stable", ignore_index=True)
        points["control_steps"] = points["length"].cumsum()
    if order is not None:
        points["wall_time"] -= points["wall_time"].min()
    if "point" not in points:
        points = points.assign(point=points.index, episode=0)
    return points
