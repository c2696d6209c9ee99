"""Points of runs: from rows of tables to arrays, and from arrays to rows of a frame.

A point is a training episode, or the mean over an evaluation.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.array_types import FloatArray
from jbench.names import ReturnsName
from jbench.returns import EVALUATION, TRAINING

POINT = ["episode_return", "control_steps", "processor_time"]
_POSES = ["x", "y", "heading", "target_x", "target_y", "target_yaw"]
PATHS = ("run", "evaluation", "control_steps", *_POSES)
"""Columns of the tables `episodes` and `evaluations`, and of `paths`, that are read."""


@dataclass(frozen=True)
class Points:
    """Points of the runs of a configuration, one run per seed.

    Attributes:
        returns: (seeds, points) returns; NaN after a run's end, or if not finite.
        control_steps: (seeds, points) control steps at each point; NaN after the run's end.
        processor_time: (seeds, points) processor time at each point in s; NaN if not recorded.
        deviations: (seeds, points) standard deviation of the episodes of each evaluation; NaN for
            training episodes, and if unknown.
        counts: (seeds, points) number of episodes of each evaluation; 1 for training episodes.
    """

    returns: FloatArray
    control_steps: FloatArray
    processor_time: FloatArray
    deviations: FloatArray
    counts: FloatArray


FIELDS = [field.name for field in fields(Points)]
"""Columns of the points of one run."""

RETURN = FIELDS.index("returns")
CONTROL_STEPS = FIELDS.index("control_steps")

NOTHING = np.empty((0, len(FIELDS)))
"""Points of a run without any."""

Part = tuple[Mapping[str, Any], Mapping[str, Any]]
"""Of a frame: names of its rows, and arrays (rows,) by column."""


def run_paths(paths: pa.Table | None, evaluations: pa.Table) -> pd.DataFrame:
    """Returns the points of the paths of each run in the order of its evaluations.

    Columns: run, steps (control steps of the run at the evaluation), episode_return (of the
    episode; NaN if it is unknown), x, y (m) and heading (rad) of the robot, target_x, target_y (m)
    and target_yaw (rad) of the target; NaN if they are not random. A path of one point is left out.
    """
    columns = ["run", "steps", "episode_return", *_POSES]
    if paths is None or not paths.num_rows:  # older versions recorded none
        return pd.DataFrame(columns=columns)

    keys = ["run", "evaluation"]
    points: pd.DataFrame = paths.to_pandas(use_threads=False).astype({"run": str})
    numbers = points[["evaluation", "control_steps", "x", "y", "heading"]].to_numpy(float)
    points = points[np.isfinite(numbers).all(axis=1)]
    points = points[points.groupby(keys)["x"].transform("size") > 1]
    returns = evaluations.to_pandas(use_threads=False).astype({"run": str})
    returns = returns[returns["episode"] == 0].drop_duplicates(keys)
    points = points.merge(returns[[*keys, "episode_return"]], on=keys, how="left")
    return points.rename(columns={"control_steps": "steps"})[columns]


def run_points(table: pa.Table, kind: ReturnsName) -> dict[str, FloatArray]:
    """Returns the points (points, `FIELDS`) in order of each run that has any.

    A point is a training episode, or the mean over the episodes of an evaluation. Numbers that are
    not finite are NaN.
    """
    number = "episode" if kind == TRAINING else "evaluation"
    columns = table.select(["run", number, *POINT]).unify_dictionaries()
    rows: pd.DataFrame = columns.to_pandas(use_threads=False)
    if kind == TRAINING:
        points = rows.rename(columns={"episode_return": "returns"})
        points = points.assign(deviations=np.nan, counts=1)
    else:
        rows[POINT] = rows[POINT].astype(float).where(np.isfinite(rows[POINT].astype(float)))
        grouped = rows.groupby(["run", number], observed=True)
        group = grouped["episode_return"]  # ignores NaN
        points = grouped[["control_steps", "processor_time"]].max()
        points = points.assign(returns=group.mean(), deviations=group.std(), counts=group.count())
        points = points.reset_index()

    order = points[number].to_numpy()
    numbers = points[FIELDS].to_numpy(float)
    numbers[~np.isfinite(numbers)] = np.nan

    return {
        str(run): numbers[places[np.argsort(order[places], kind="stable")]]
        for run, places in points.groupby("run", observed=True).indices.items()
    }


def stacked(runs: Sequence[FloatArray], kind: ReturnsName) -> Points:
    """Returns the points (points, `FIELDS`) of several runs together, padded with NaN.

    Training episodes are aligned by their index, evaluations by the control steps before them.
    """
    columns = [np.arange(len(run)) for run in runs]
    if kind == EVALUATION:
        at = [run[:, CONTROL_STEPS] for run in runs]
        grid = np.unique(np.concatenate(at))
        columns = [np.searchsorted(grid, steps) for steps in at]

    shape = len(runs), max(int(column[-1]) + 1 if len(column) else 0 for column in columns)
    stacked = np.full((len(FIELDS), *shape), np.nan)
    for row, (run, column) in enumerate(zip(runs, columns, strict=True)):
        stacked[:, row, column] = run.T

    return Points(*stacked)


def count_divergence(
    points: Points,
    at: FloatArray,
    lowest: FloatArray,
    planned: int,
    kind: ReturnsName,
    episode_steps: int,
) -> Points:
    """Returns the points with diverged seeds extended to the end of the others, or as planned.

    Args:
        points: of all seeds; they may be changed in place.
        at: control steps (seeds,) after which they diverged; NaN if they did not.
        lowest: return (seeds,) that they count with from then on; see `diverged_return`.
        planned: control steps of a run.
        kind: of the returns.
        episode_steps: control steps of an episode.
    """
    planned = max(planned, int(np.nanmax(at)))
    has_diverged = np.isfinite(at)
    if has_diverged.all():
        count = _points_to_plan(points.control_steps, planned, kind, episode_steps)
        points = _with_empty_points(points, count)

    control_steps = points.control_steps
    present = np.isfinite(control_steps)
    grid = np.max(np.where(present, control_steps, -np.inf), axis=0)
    empty = np.flatnonzero(np.isinf(grid))
    grid[empty] = (empty + 1) * episode_steps if kind == TRAINING else planned

    for row in np.flatnonzero(has_diverged):
        added = ~present[row] & (grid >= at[row])
        if not (present[row] | added).any():
            added[-1] = True
        after = added | (present[row] & (control_steps[row] > at[row]))
        control_steps[row, added] = grid[added]
        points.returns[row, after] = lowest[row]
        points.counts[row, added] = 1.0
        if kind == EVALUATION:
            points.deviations[row, after] = 0.0

    end = planned if has_diverged.all() else np.nanmax(control_steps[~has_diverged])
    return _continued(points, at, lowest, end, kind)


def _points_to_plan(
    control_steps: FloatArray, planned: int, kind: ReturnsName, episode_steps: int
) -> int:
    """Returns how many points seeds that have all diverged lack up to the planned control steps.

    Training episodes are as long as they can be; of evaluations one more is enough.
    """
    if kind == TRAINING:
        episodes = max(1, -(-planned // episode_steps))  # rounded up
        missing: int = episodes - control_steps.shape[1]
        return max(0, missing)
    last = float(np.nanmax(control_steps, initial=0.0))
    return 1 if last < planned else 0


def _continued(
    points: Points, at: FloatArray, lowest: FloatArray, end: float, kind: ReturnsName
) -> Points:
    """Returns the points with two more of each diverged seed whose points end before `end`.

    Where episodes end early, such a seed may have more of them than the others, up to an earlier
    control step. See `count_divergence` for the arguments.
    """
    control_steps = points.control_steps
    last = np.max(np.where(np.isfinite(control_steps), control_steps, 0.0), axis=1)
    is_short = np.isfinite(at) & (last < end)
    if not is_short.any():
        return points

    points = _with_empty_points(points, 2)
    points.control_steps[is_short, -2] = np.minimum(np.maximum(at, last) + 1, end)[is_short]
    points.control_steps[is_short, -1] = end
    points.returns[is_short, -2:] = lowest[is_short, None]
    points.counts[is_short, -2:] = 1.0
    if kind == EVALUATION:
        points.deviations[is_short, -2:] = 0.0

    return points


def _with_empty_points(points: Points, count: int) -> Points:
    """Returns the points with a number of further ones at their end, which are NaN."""
    after = ((0, 0), (0, count))
    arrays = (getattr(points, name) for name in FIELDS)
    return Points(*(np.pad(array, after, constant_values=np.nan) for array in arrays))


def long_frame(parts: Iterable[Part], columns: Sequence[str]) -> pd.DataFrame:
    """Returns the arrays of all parts below each other; a row has the names of its part."""
    pairs = [(names, arrays) for names, arrays in parts if len(next(iter(arrays.values())))]
    if not pairs:
        return pd.DataFrame(columns=[*columns])

    names = pd.DataFrame([names for names, _ in pairs])
    sizes = [len(next(iter(arrays.values()))) for _, arrays in pairs]
    # Texts are repeated once for all parts, which is much faster than a frame for each.
    rows = names.loc[names.index.repeat(sizes)].reset_index(drop=True)
    joined = {name: np.concatenate([arrays[name] for _, arrays in pairs]) for name in pairs[0][1]}
    return rows.assign(**joined).reindex(columns=[*columns])
