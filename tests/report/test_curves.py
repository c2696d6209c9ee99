"""Tests of the aggregation of learning curves across seeds, against hand-computed numbers."""

import numpy as np
import pytest

from jbench.report.data.curves import (
    QUANTILES,
    final_returns,
    learning_curve,
    quantiles_across_seeds,
)


def cell(*runs):
    """Returns runs of any lengths as the arrays of a cell."""
    lengths = np.array([len(run) for run in runs])
    returns = np.full((len(runs), lengths.max()), np.nan)
    control_steps = returns.copy()
    for row, run in enumerate(runs):
        returns[row, : len(run)] = run
        control_steps[row, : len(run)] = 1000 * (np.arange(len(run)) + 1)
    return returns, control_steps, lengths


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
    turns = cell([0, 10] * 4, [10, 0] * 4, [4] * 8)
    curve = learning_curve(*turns, order, 2)
    np.testing.assert_allclose(curve.quantiles[:, 1:-1], np.transpose([expected] * 7))
    # Points are at the centers of windows.
    assert curve.control_steps.tolist() == [*(1000, 1500, 2500, 3500, 4500, 5500, 6500, 7500, 8000)]
    assert curve.seeds.tolist() == [3] * 9


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
def test_windows_are_truncated_at_both_ends(order):
    run = np.arange(20.0) ** 2
    curve = learning_curve(*cell(run), order, 5)
    assert curve.control_steps.tolist() == [1000 * i for i in range(1, 21)]
    assert curve.widths.tolist() == [3, 4, *[5] * 16, 4, 3]
    assert curve.quantile(50)[:3].tolist() == [5 / 3, 14 / 4, 30 / 5]  # of 0, 1, 4, 9, 16
    assert curve.quantile(50)[-1] == (17**2 + 18**2 + 19**2) / 3
    # Between the ends the published definition holds: the mean over full windows.
    np.testing.assert_allclose(curve.quantile(50)[2:-2], np.convolve(run, np.ones(5) / 5, "valid"))


UNEQUAL = cell([0] * 8, [10] * 12, [20] * 12)
WITH_NAN = cell([1] * 8, [3] * 4 + [np.nan] * 4)


@pytest.mark.parametrize(
    ("runs", "order", "medians", "seeds"),
    [
        # Median 10 of three seeds in 8 episodes, then 15 of two; the window between has both.
        (UNEQUAL, "quantile-first", [10] * 8 + [12.5] + [15] * 4, [3] * 8 + [2] * 5),
        (UNEQUAL, "smooth-first", [10] * 8 + [15] * 5, [3] * 8 + [2] * 5),
        (WITH_NAN, "quantile-first", [2] * 4 + [1.5] + [1] * 4, [2] * 5 + [1] * 4),
        (WITH_NAN, "smooth-first", [2] * 5 + [1] * 4, [2] * 5 + [1] * 4),
    ],
)
def test_seeds_count_while_they_have_returns(runs, order, medians, seeds):
    curve = learning_curve(*runs, order, 2)
    assert curve.quantile(50).tolist() == medians
    assert curve.seeds.tolist() == seeds


def test_window_of_short_runs_is_quarter_of_longest():
    lengths = (5000, 400, 399, 40, 7)
    curves = [learning_curve(*cell([0.0] * 3, [1.0] * n), "quantile-first", 100) for n in lengths]
    assert [curve.window for curve in curves] == [100, 100, 99, 10, 1]


def test_control_steps_of_curve_do_not_decrease_after_end_of_seed():
    steps = np.array([[1000.0, 2000, 3000, 4000], [3000, 6000, np.nan, np.nan]])
    curve = learning_curve(np.ones((2, 4)), steps, np.array([4, 2]), "quantile-first", 1)
    # Means of both seeds are 2000 and 4000. Then only the first one is left, at 3000 and 4000.
    assert curve.control_steps.tolist() == [2000, 4000, 4000, 4000]


def test_quantiles_equal_numpy_nanquantile():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(7, 200))
    values[rng.random(values.shape) < 0.3] = np.nan
    values[0] = 1.0  # so that no column is empty, of which numpy would warn
    expected = np.nanquantile(values, np.array(QUANTILES) / 100, axis=0)
    np.testing.assert_allclose(quantiles_across_seeds(values), expected, rtol=1e-13)


def test_final_return_averages_last_quarter_capped_at_100():
    runs = cell([0] * 900 + [5] * 100, [0] * 9 + [1, 2, 6], [9, 9, 1])
    returns, control_steps, *_ = final_returns(*runs)
    assert returns.tolist() == [5.0, 3.0, 1.0]
    assert control_steps.tolist() == [950_500, 11_000, 3_000]
