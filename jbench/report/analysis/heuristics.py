"""Tests claim (h) on evaluations of the hand-written policies."""

import json
from collections.abc import Mapping

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import HEURISTIC, TASKS
from jbench.report.analysis.claims import Finding
from jbench.report.analysis.examine import examine_heuristic
from jbench.report.data.cells import in_order
from jbench.report.data.curves import FloatArray


def findings(
    tables: Mapping[str, pa.Table], task: str | None = None
) -> tuple[list[Finding], list[str]]:
    """Returns a finding for each task whose hand-written policy was evaluated, and notes.

    Args:
        tables: `policy_evaluations` and `policy_episodes` are used.
        task: only this task; None for all.
    """
    if "policy_evaluations" not in tables:
        return [], []
    returns = returns_by_task(tables)
    tasks = in_order(returns if task is None else {task} & returns.keys(), TASKS)
    findings = [examine_heuristic(name, returns[name]) for name in tasks]
    missing = [name for name in (TASKS if task is None else (task,)) if name not in returns]
    if not missing:
        return findings, []
    note = (
        f"Claim (h) is not tested on {', '.join(missing)}: type `jbench evaluate --policy "
        f"{HEURISTIC} --task {missing[0]}`."
    )
    return findings, [note]


def returns_by_task(tables: Mapping[str, pa.Table]) -> dict[str, FloatArray]:
    """Returns the finite returns (episodes,) of the hand-written policy of each task.

    The evaluation of a task with the most episodes counts, or the newest of several such. Only
    evaluations on the plain robot with random targets count.
    """
    if "policy_evaluations" not in tables:
        return {}
    rows = tables["policy_evaluations"].to_pandas(use_threads=False)
    chosen = _chosen(rows[(rows["policy"] == HEURISTIC) & (rows["status"] == "finished")])
    episodes = tables["policy_episodes"].to_pandas(use_threads=False)
    returns = {}
    for name, evaluation in chosen.items():
        of_evaluation = episodes[episodes["evaluation"] == evaluation]
        numbers = of_evaluation["episode_return"].to_numpy(np.float64)
        returns[name] = numbers[np.isfinite(numbers)]
    return returns


def _chosen(rows: pd.DataFrame) -> dict[str, str]:
    """Returns the id of the evaluation that counts, by task."""
    plain = [
        settings.get("augment") is None and settings.get("target_yaw") is None
        for settings in map(json.loads, rows["settings"])
    ]
    ranked = (
        rows[np.array(plain, bool)]
        .dropna(subset=["task", "episodes"])
        .sort_values(["episodes", "created"])
    )
    return dict(zip(ranked["task"], ranked["evaluation"], strict=True))
