"""Paths of robots in the first and the last evaluation of runs."""

import numpy as np
import pandas as pd
import pyarrow as pa

_POSES = ["x", "y", "heading", "target_x", "target_y", "target_yaw"]
COLUMNS = ("run", "evaluation", "control_steps", *_POSES)
"""Columns of the table `paths` that are read."""


def run_paths(paths: pa.Table | None, evaluations: pa.Table) -> pd.DataFrame:
    """Returns the points of the paths of each run in the order of its evaluations.

    Columns: run, steps (control steps of the run at the evaluation), episode_return (of the
    episode; NaN if it is unknown), x, y (m) and heading (rad) of the robot, target_x, target_y (m)
    and target_yaw (rad) of the target; NaN if they are not random. A path of one point is left out.

    Args:
        paths: rows of the table of that name, with `COLUMNS`; None if there are none.
        evaluations: rows of the table of that name.
    """
    columns = ["run", "steps", "episode_return", *_POSES]
    if paths is None or not paths.num_rows:  # older versions recorded none
        return pd.DataFrame(columns=columns)
    points: pd.DataFrame = paths.to_pandas(use_threads=False).astype({"run": str})
    numbers = points[["evaluation", "control_steps", "x", "y", "heading"]].astype(float)
    points = points[numbers.map(np.isfinite).all(axis=1)]
    sizes = points.groupby(["run", "evaluation"])["x"].transform("size")
    points = points[sizes > 1]
    returns = evaluations.to_pandas(use_threads=False).astype({"run": str})
    returns = returns[returns["episode"] == 0].drop_duplicates(["run", "evaluation"])
    returns = returns[["run", "evaluation", "episode_return"]]
    points = points.merge(returns, on=["run", "evaluation"], how="left")
    named: pd.DataFrame = points.rename(columns={"control_steps": "steps"})
    return named[columns]
