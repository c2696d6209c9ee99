"""What the evaluations of the hand-written policies say of the claim on them."""

import json
from collections.abc import Mapping

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import TASKS
from jbench.report.analysis.claims import Finding
from jbench.report.analysis.examine import examine_heuristic
from jbench.report.data.cells import in_order

_POLICY = "heuristic"


def findings(
    tables: Mapping[str, pa.Table], task: str | None = None
) -> tuple[list[Finding], list[str]]:
    """Returns a finding for each task whose hand-written policy was evaluated, and notes.

    Of several evaluations of a task, the one of most episodes counts, the newest of those. Only
    the plain robot counts, and targets drawn as the task draws them.

    Args:
        tables: of the results, `policy_evaluations` and `policy_episodes` among them.
        task: only this one.
    """
    if "policy_evaluations" not in tables:
        return [], []
    rows = tables["policy_evaluations"].to_pandas(use_threads=False)
    chosen = _chosen(rows[(rows["policy"] == _POLICY) & (rows["status"] == "finished")])
    wanted = in_order(chosen if task is None else {task} & chosen.keys(), TASKS)
    episodes = tables["policy_episodes"].to_pandas(use_threads=False)
    found = []
    for name in wanted:
        returns = episodes.loc[episodes["evaluation"] == chosen[name], "episode_return"]
        numbers = returns.to_numpy(np.float64)
        found.append(examine_heuristic(name, numbers[np.isfinite(numbers)]))
    missing = [name for name in (TASKS if task is None else (task,)) if name not in chosen]
    notes = (
        [
            f"Claim (h) is not tested on {', '.join(missing)}: type `jbench evaluate --policy "
            f"heuristic --task {missing[0]}`."
        ]
        if missing
        else []
    )
    return found, notes


def _chosen(rows: pd.DataFrame) -> dict[str, str]:
    """Returns the evaluation that counts, by task."""
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
