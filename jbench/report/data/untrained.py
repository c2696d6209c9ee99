"""Policies without training, which stand beside the agents: random actions, and hand-written ones.

Of such a policy, a report shows the mean return of its episodes. The return of an agent is a mean
of episodes, too, so the two compare; a median of episodes would not, where returns are skewed.
"""

from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.report.data.source_names import OWN
from jbench.statistics import bootstrap as st

RANDOM = "random"
"""The policy of random actions, as `jbench evaluate` and the column `policy` name it."""

HAND_WRITTEN = "hand-written"
"""The hand-written policy of a task in the column `policy`."""

SHIPPED = "baselines.csv"
"""File of the package jbench.report with the policies of the five tasks."""


def untrained_row(task: str, policy: str, returns: FloatArray) -> dict[str, Any]:
    """Returns the numbers of a policy without training.

    They are the mean and the median of its episodes, with their 95% intervals (low and high are
    the median's), the 10th and 90th percentile of the episodes, and how many there are.

    Args:
        task: the task's name.
        policy: `RANDOM` or `HAND_WRITTEN`.
        returns: (episodes,) finite returns, one or more.
    """
    median, mean = (sample.estimate() for sample in st.samples([st.median, st.mean], [returns]))
    q10, q90 = np.percentile(returns, (10, 90))
    return {
        "task": task,
        "policy": policy,
        "mean": mean.value,
        "mean_low": mean.low,
        "mean_high": mean.high,
        "median": median.value,
        "low": median.low,
        "high": median.high,
        "q10": q10,
        "q90": q90,
        "episodes": len(returns),
    }


@cache
def shipped_untrained() -> pd.DataFrame:
    """Returns the rows of the five tasks, see `untrained_row`, which no caller may change."""
    return pd.read_csv(str(resources.files("jbench.report").joinpath(SHIPPED)))


def random_return(task: str) -> float:
    """Returns the mean return of random actions on one of the five tasks."""
    rows = shipped_untrained()
    return float(rows[(rows["task"] == task) & (rows["policy"] == RANDOM)]["mean"].item())


def as_agents(policies: pd.DataFrame) -> pd.DataFrame:
    """Returns policies without training as rows that stand below the configurations of agents.

    A policy is one agent, so the mean of its episodes stands for the median and the interquartile
    mean of seeds.

    Args:
        policies: rows of `untrained_row`.
    """
    means = {
        f"{average}{end}": policies[f"mean{end}"]
        for average in ("median", "iqm")
        for end in ("", "_low", "_high")
    }
    names = policies["policy"].replace(RANDOM, "random actions")
    return policies.assign(source=OWN, representation="", words="", algo=names, **means)
