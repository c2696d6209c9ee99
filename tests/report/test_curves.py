"""Tests of the aggregation of learning curves across seeds, against hand-computed numbers."""

import numpy as np
import pytest

from jbench.report.data.curves import (
    QUANTILES,
    final_returns,
    fitting_window,
    learning_curve,
    moving_average,
    quantiles_across_seeds,
    steps_to_threshold,
)

NAN = np.nan


def cell(*runs, environments=1):
    """Returns runs of any lengths as the arrays of a cell."""
    lengths = np.array([len(run) for run in runs])
    returns = np.full((len(runs), lengths.max()), NAN)
    control_steps = returns.copy()
    for row, run in enumerate(runs):
        returns[row, : len(run)] = run
        index = np.arange(len(run))
        control_steps[row, : len(run)] = (index // environments + 1) * environments * 1000
    return returns, control_steps, lengths


# Two alternating seeds and a constant one: single episodes differ, averages hardly do.
TURNS = cell([0, 10] * 4, [10, 0] * 4, [4] * 8)


def test_quantile_first_keeps_spread_of_single_episodes():
    curve = learning_curve(*TURNS, "quantile-first", 2)
    # Each episode has the returns 0, 4 and 10: positions 0.2, 0.5, 1, 1.5 and 1.8 among them.
    expected = np.array([0.8, 2.0, 4.0, 7.0, 8.8])
    np.testing.assert_allclose(curve.quantiles, np.tile(expected[:, None], 9))


def test_smooth_first_averages_out_spread_of_single_episodes():
    curve = learning_curve(*TURNS, "smooth-first", 2)
    # Each whole window has the means 4, 5 and 5.
    expected = np.array([4.2, 4.5, 5.0, 5.0, 5.0])
    np.testing.assert_allclose(curve.quantiles[:, 1:-1], np.tile(expected[:, None], 7))


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
def test_points_are_at_window_centers_between_first_and_last_episode(order):
    curve = learning_curve(*TURNS, order, 2)
    assert curve.control_steps.tolist() == [*(1000, 1500, 2500, 3500, 4500, 5500, 6500, 7500, 8000)]
    assert curve.seeds.tolist() == [3] * 9
    assert curve.widths.tolist() == [1, *[2] * 7, 1]
    assert (curve.order, curve.window) == (order, 2)


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
def test_windows_are_truncated_at_both_ends(order):
    run = np.arange(20.0) ** 2
    curve = learning_curve(*cell(run), order, 5)
    assert curve.control_steps.tolist() == [1000 * i for i in range(1, 21)]
    assert curve.widths.tolist() == [3, 4, *[5] * 16, 4, 3]
    assert curve.quantile(50)[:3].tolist() == [5 / 3, 14 / 4, 30 / 5]  # of 0, 1, 4, 9, 16
    assert curve.quantile(50)[-1] == (17**2 + 18**2 + 19**2) / 3
    assert (curve.widths == curve.window).tolist() == [False] * 2 + [True] * 16 + [False] * 2
    # Between the ends the published definition holds: the mean over full windows.
    np.testing.assert_allclose(curve.quantile(50)[2:-2], np.convolve(run, np.ones(5) / 5, "valid"))


class TestUnequalLengths:
    RUNS = cell([0] * 8, [10] * 12, [20] * 12)

    def test_quantile_first_uses_seeds_that_reached_each_episode(self):
        curve = learning_curve(*self.RUNS, "quantile-first", 2)
        # Median 10 of three seeds in 8 episodes, then 15 of two; the window between has both.
        assert curve.quantile(50).tolist() == [10.0] * 8 + [12.5] + [15.0] * 4
        assert curve.quantile(10).tolist() == pytest.approx([2.0] * 8 + [6.5] + [11.0] * 4)

    def test_smooth_first_uses_seeds_with_full_window(self):
        curve = learning_curve(*self.RUNS, "smooth-first", 2)
        assert curve.quantile(50).tolist() == [10.0] * 8 + [15.0] * 5


def test_nan_is_ignored_and_seeds_with_only_nan_are_not_counted():
    runs = cell([1] * 8, [3] * 4 + [NAN] * 4)
    for order in ("quantile-first", "smooth-first"):
        curve = learning_curve(*runs, order, 2)
        assert curve.seeds.tolist() == [2] * 5 + [1] * 4
    quantile_first = learning_curve(*runs, "quantile-first", 2).quantile(50)
    assert quantile_first.tolist() == [2.0, 2.0, 2.0, 2.0, 1.5, 1.0, 1.0, 1.0, 1.0]
    smooth_first = learning_curve(*runs, "smooth-first", 2).quantile(50)
    assert smooth_first.tolist() == [2.0] * 5 + [1.0] * 4


@pytest.mark.parametrize(
    ("lengths", "window", "expected"),
    [
        ([400, 5000], 100, 100),
        ([3, 5000], 100, 100),
        ([3, 399], 100, 99),
        ([40], 100, 10),
        ([7], 100, 1),
        ([1], 100, 1),
        ([5000], 1, 1),
    ],
)
def test_window_of_short_runs_is_quarter_of_longest(lengths, window, expected):
    assert fitting_window(np.array(lengths), window) == expected


def test_control_steps_of_curve_do_not_decrease_after_end_of_seed():
    steps = np.array([[1000.0, 2000, 3000, 4000], [3000, 6000, np.nan, np.nan]])
    curve = learning_curve(np.ones((2, 4)), steps, np.array([4, 2]), window=1)
    # Means of both seeds are 2000 and 4000. Then only the first one is left, at 3000 and 4000.
    assert curve.control_steps.tolist() == [2000, 4000, 4000, 4000]


def test_moving_average_accumulates_no_rounding_error():
    values = np.array([[1e6 / 3] * 5 + [0.0] * 5])
    assert moving_average(values, 3)[0, -3:].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_quantiles_equal_numpy_nanquantile(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(7, 40))
    values[rng.random(values.shape) < 0.3] = NAN
    values[0] = 1.0  # so that no column is empty, of which numpy would warn
    expected = np.nanquantile(values, np.array(QUANTILES) / 100, axis=0)
    np.testing.assert_allclose(quantiles_across_seeds(values), expected, rtol=1e-13)


def test_final_return_averages_last_quarter_capped_at_100():
    runs = cell([0] * 900 + [5] * 100, [0] * 9 + [1, 2, 6], [9, 9, 1])
    returns, control_steps = final_returns(*runs)
    assert returns.tolist() == [5.0, 3.0, 1.0]
    assert control_steps.tolist() == [950_500, 11_000, 3_000]


def test_final_return_ignores_nan_and_is_nan_without_returns():
    returns, _ = final_returns(*cell([0] * 6 + [NAN, 4], [0] * 6 + [NAN, NAN]))
    assert returns[0] == 4.0
    assert np.isnan(returns[1])


def test_steps_to_threshold_are_infinite_if_never_reached():
    returns = np.array([[1.0, 5.0, 9.0], [9.0, 1.0, NAN], [1.0, 2.0, 3.0]])
    steps = steps_to_threshold(returns, np.tile([10.0, 20.0, 30.0], (3, 1)), 5.0)
    assert steps.tolist() == [20.0, 10.0, np.inf]
