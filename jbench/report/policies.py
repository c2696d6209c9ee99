"""Policies beside the agents: random actions, and the hand-written policy of each task."""

import json
from collections.abc import Mapping
from importlib import resources

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import HEURISTIC, TASKS
from jbench.report.analysis import statistics as st
from jbench.report.analysis.claims import Finding
from jbench.report.analysis.examine import examine_heuristic
from jbench.report.data.cells import in_order
from jbench.report.data.curves import FloatArray

COLUMNS = ["task", "policy", "median", "low", "high", "q10", "q90", "episodes"]


def shipped_episodes() -> pd.DataFrame:
    """Returns the shipped episodes of random actions and hand-written policies.

    Columns: task, policy (`random` or `hand-written`), episode, episode_return;
    `benchmarks/baselines.py` has written them.
    """
    return pd.read_csv(str(resources.files("jbench.report").joinpath("baselines.csv")))


def baseline_frame(tasks: set[str]) -> pd.DataFrame:
    """Returns the shipped policies' median return, by task.

    Columns: task, policy, median with its 95% interval (low, high), q10 and q90 (10th and 90th
    percentile of the episodes), episodes.
    """
    rows = []
    for (task, policy), episodes in shipped_episodes().groupby(["task", "policy"], sort=False):
        if task in tasks:
            returns = episodes["episode_return"].to_numpy(float)
            median, low, high, _ = st.estimate(st.median, [returns])
            q10, q90 = np.percentile(returns, (10, 90))
            rows.append((task, policy, median, low, high, q10, q90, len(returns)))
    return pd.DataFrame(rows, columns=COLUMNS)


def findings(
    tables: Mapping[str, pa.Table], task: str | None = None
) -> tuple[list[Finding], list[str]]:
    """Returns a finding on claim (h) for each task whose hand-written policy was evaluated.

    Args:
        tables: `policy_evaluations` and `policy_episodes` are used.
        task: only this task; None for all.

    Returns:
        Findings, and notes on the other tasks.
    """
    if "policy_evaluations" not in tables:
        return [], []
    returns = hand_written_returns(tables)
    tasks = in_order(returns if task is None else {task} & returns.keys())
    found = [examine_heuristic(name, returns[name]) for name in tasks]
    missing = [name for name in (TASKS if task is None else (task,)) if name not in returns]
    if not missing:
        return found, []
    note = (
        f"Claim (h) is not tested on {', '.join(missing)}: type `jbench evaluate --policy "
        f"{HEURISTIC} --task {missing[0]}`."
    )
    return found, [note]


def hand_written_returns(tables: Mapping[str, pa.Table]) -> dict[str, FloatArray]:
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
        numbers = episodes["episode_return"][episodes["evaluation"] == evaluation].to_numpy(float)
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
