"""Paths of robots in the first and the last evaluation of runs."""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbench.report.data.building import coded, numbers
from jbench.report.data.curves import FloatArray

_POSES = ("x", "y", "heading", "target_x", "target_y", "target_yaw")
COLUMNS = ("run", "evaluation", "control_steps", *_POSES)
"""Columns of the table `paths` that are read."""


class RunPath(NamedTuple):
    """Path of the robot in the first episode of an evaluation.

    Attributes:
        control_steps: of the run, at the evaluation.
        episode_return: of the episode; NaN if it is unknown.
        points: (n, 2) x and y (m).
        heading: at the end (rad).
        target: (3,) x, y (m) and yaw (rad) of the target; NaN if they are not random.
    """

    control_steps: float
    episode_return: float
    points: FloatArray
    heading: float
    target: FloatArray


def run_paths(paths: pa.Table, evaluations: pa.Table) -> dict[str, list[RunPath]]:
    """Returns the paths of each run in the order of its evaluations.

    Args:
        paths: rows of the table of that name, with `COLUMNS`.
        evaluations: rows of the table of that name.
    """
    if not paths.num_rows:  # older versions recorded none
        return {}
    names, codes = coded(paths["run"])
    keys = np.column_stack([codes, numbers(paths, "evaluation"), numbers(paths, "control_steps")])
    values = np.column_stack([numbers(paths, name) for name in _POSES])
    known = np.isfinite(keys).all(axis=1) & np.isfinite(values[:, :3]).all(axis=1)
    keys, values = keys[known], values[known]
    ends = np.flatnonzero(np.diff(keys, axis=0).any(axis=1)) + 1
    returns = _first_returns(evaluations)
    found: dict[str, list[RunPath]] = {}
    for key, rows in zip(np.split(keys, ends), np.split(values, ends), strict=True):
        if len(rows) < 2:
            continue
        code, number, control_steps = key[0].tolist()
        run, last = names[int(code)], rows[-1]
        episode_return = returns.get((run, number), np.nan)
        path = RunPath(control_steps, episode_return, rows[:, :2], float(last[2]), last[3:])
        found.setdefault(run, []).append(path)
    return found


def _first_returns(evaluations: pa.Table) -> dict[tuple[str, float], float]:
    """Returns the return of the first episode of each evaluation, by its run and number."""
    firsts = evaluations.filter(pc.equal(evaluations["episode"], 0))
    names, codes = coded(firsts["run"])
    columns = (numbers(firsts, name).tolist() for name in ("evaluation", "episode_return"))
    rows = zip(codes.tolist(), *columns, strict=True)
    return {(names[code], number): value for code, number, value in rows}
