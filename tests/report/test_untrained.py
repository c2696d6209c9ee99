"""Tests of the policies without training that stand beside the agents."""

import numpy as np
import pytest

from jbench.names import TASKS
from jbench.numbers import whole, with_interval
from jbench.report.data.untrained import (
    HAND_WRITTEN,
    RANDOM,
    random_return,
    shipped_untrained,
    untrained_row,
)
from tests.documentation import ROOT

EPISODES = 100


def test_a_row_has_the_mean_of_skewed_episodes_and_its_interval():
    # By hand: 90 episodes of 700 to 789 and ten of 100 have a mean of 680 and a median of 739.5.
    returns = np.append(np.arange(700.0, 790.0), np.full(10, 100.0))
    row = untrained_row("face_direction", RANDOM, returns)
    assert (row["mean"], row["median"], row["episodes"]) == (680.05, 739.5, 100)
    assert (row["q10"], row["q90"]) == pytest.approx((640.0, 779.1))

    # The standard error of the mean is 19.5.
    half = 1.96 * returns.std(ddof=1) / 10
    assert (row["mean_low"], row["mean_high"]) == pytest.approx((680 - half, 680 + half), abs=4)
    assert row["mean_high"] < row["low"] < row["median"] < row["high"]


def test_fewer_than_three_episodes_have_no_interval():
    row = untrained_row("face_direction", RANDOM, np.array([1.0, 2.0]))
    assert row["mean"] == 1.5
    assert np.isnan([row["mean_low"], row["mean_high"], row["low"], row["high"]]).all()


def test_the_shipped_policies_have_means_in_their_intervals():
    rows = shipped_untrained()
    assert [*zip(rows["task"], rows["policy"], strict=True)] == [
        (task, policy) for task in TASKS for policy in (RANDOM, HAND_WRITTEN)
    ]
    assert set(rows["episodes"]) == {EPISODES}
    assert (rows["mean_low"] < rows["mean"]).all()
    assert (rows["mean"] < rows["mean_high"]).all()
    for task in TASKS:
        mean = rows[rows["task"] == task]["mean"].iloc[0]
        assert random_return(task) == mean


def test_the_page_on_policies_shows_the_shipped_numbers():
    shipped = shipped_untrained().set_index(["task", "policy"])
    page = (ROOT / "docs" / "policies.md").read_text("utf-8")
    for task in TASKS:
        random = cells_in(shipped.loc[task, RANDOM])
        by_hand = cells_in(shipped.loc[task, HAND_WRITTEN])
        assert f"| `{task}` | {' | '.join(random + by_hand)} |" in page


def cells_in(row):
    """Returns the mean with its interval, and the median with the percentiles of episodes."""
    return [
        with_interval(whole, row["mean"], (row["mean_low"], row["mean_high"])),
        f"{row['median']:.0f} [{row['q10']:.0f}, {row['q90']:.0f}]",
    ]
