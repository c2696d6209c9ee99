"""Tests of the aggregation of learning curves across seeds, against hand-computed numbers."""

import numpy as np
import pytest

from jbench.report.data.common_steps import at_common_steps
from jbench.report.data.curves import (
    QUANTILES,
    final_returns,
    learning_curve,
    quantiles_across_seeds,
    seed_curve,
)
from jbench.returns import TRAINING


def cell(*runs):
    """Returns runs of any lengths as arrays: returns, control steps, and numbers of episodes."""
    lengths = np.array([len(run) for run in runs])
    returns = np.full((len(runs), lengths.max()), np.nan)
    control_steps = returns.copy()
    for row, run in enumerate(runs):
        returns[row, : len(run)] = run
        control_steps[row, : len(run)] = 1000 * (np.arange(len(run)) + 1)
    return returns, control_steps, lengths


def drawn(runs, order, window):
    """Returns the learning curve of runs of any lengths."""
    returns, control_steps, _ = cell(*runs)
    common = at_common_steps(TRAINING, returns, control_steps, control_steps)
    return learning_curve(common.returns, common.control_steps, order, window)


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        # Each episode has the returns 0, 4 and 10: positions 0.2, 0.5, 1, 1.5 and 1.8 among them.
        ("quantile-first", [0.8, 2.0, 4.0, 7.0, 8.8]),
        # Each whole window has the means 4, 5 and 5.
        ("smooth-first", [4.2, 4.5, 5.0, 5.0, 5.0]),
    ],
)
def test_smoothing_first_averages_out_spread_of_single_episodes(order, expected):
    curve = drawn([[0, 10] * 4, [10, 0] * 4, [4] * 8], order, 2)
    np.testing.assert_allclose(curve.quantiles[:, 1:-1], np.transpose([expected] * 7))
    # Points are at the centers of windows.
    assert curve.control_steps.tolist() == [1000, 1500, 2500, 3500, 4500, 5500, 6500, 7500, 8000]
    assert curve.seeds == 3


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
def test_windows_are_truncated_at_both_ends(order):
    run = np.arange(20.0) ** 2
    curve = drawn([run], order, 5)
    assert curve.control_steps.tolist() == [1000 * i for i in range(1, 21)]
    assert curve.widths.tolist() == [3, 4, *[5] * 16, 4, 3]
    assert curve.quantile(50)[:3].tolist() == [5 / 3, 14 / 4, 30 / 5]  # of 0, 1, 4, 9, 16
    assert curve.quantile(50)[-1] == (17**2 + 18**2 + 19**2) / 3
    # Between the ends the published definition holds: the mean over full windows.
    np.testing.assert_allclose(curve.quantile(50)[2:-2], np.convolve(run, np.ones(5) / 5, "valid"))


UNEQUAL = [[0] * 8, [10] * 12, [20] * 12]
WITH_NAN = [[1] * 8, [3] * 4 + [np.nan] * 4]
WITH_GAP = [[1] * 8, [3, 3, np.nan, np.nan, 3, 3, 3, 3]]


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
@pytest.mark.parametrize(
    ("runs", "median", "end"),
    [
        # The median 15 of the two longer seeds is not one of three.
        (UNEQUAL, 10, 8000),
        (WITH_NAN, 2, 4000),
        (WITH_GAP, 2, 8000),
    ],
)
def test_every_point_is_of_every_seed(runs, order, median, end):
    curve = drawn(runs, order, 2)
    assert curve.quantile(50).tolist() == [median] * len(curve.control_steps)
    assert (curve.control_steps[-1], curve.seeds) == (end, len(runs))


def test_window_of_short_runs_is_quarter_of_shortest():
    lengths = (5000, 400, 399, 40, 7)
    curves = [drawn([[0.0] * 9000, [1.0] * n], "quantile-first", 100) for n in lengths]
    assert [curve.window for curve in curves] == [100, 100, 99, 10, 1]


def test_curve_of_one_seed_goes_on_to_its_own_end():
    curve = seed_curve(np.array([1.0, 1, 1, 1, 5, 5, 5, 5]), 1000 * np.arange(1.0, 9), 2)
    assert curve.values.tolist() == [1, 1, 1, 1, 3, 5, 5, 5, 5]
    assert (curve.control_steps[-1], curve.window) == (8000, 2)


def test_quantiles_equal_those_of_numpy():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(7, 200))
    expected = np.quantile(values, np.array(QUANTILES) / 100, axis=0)
    np.testing.assert_allclose(quantiles_across_seeds(values), expected, rtol=1e-13)


def test_final_return_averages_last_quarter_capped_at_100():
    runs = cell([0] * 900 + [5] * 100, [0] * 9 + [1, 2, 6], [9, 9, 1])
    returns, control_steps, *_ = final_returns(*runs, "training")
    assert returns.tolist() == [5.0, 3.0, 1.0]
    assert control_steps.tolist() == [950_500, 11_000, 3_000]
