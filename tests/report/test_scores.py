"""Tests of the statistics and comparisons of cells against hand-computed numbers."""

import math

import numpy as np
import pytest

from jbench.report.analysis.comparisons import best_of, within
from jbench.report.analysis.scores import BY_EPISODES, scores_of, statistics_frame, summaries
from jbench.report.data.published import best_at_end
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.report.sources import OURS

HALF_OF_THE_BEST = 963.4 / 2  # TD3 on face_direction, Figure 9


def flat(fabric, finals, episodes=40, **settings):
    """Adds a run of constant returns for each seed."""
    for seed, final in enumerate(finals):
        fabric.run(np.full(episodes, float(final)), seed, **settings)


def summarized(fabric, published, window=4):
    return summaries(fabric.learned(window=window), published)


def value(summary, measure, statistic):
    return summary.get(measure, statistic).estimate.value


def test_location_and_spread_match_hand_computed_values(fabric, published):
    flat(fabric, range(0, 880, 80))  # 0, 80, … 800: eleven seeds
    (summary,) = summarized(fabric, published)
    assert value(summary, "final_return", "median") == 400
    # Two of eleven seeds are trimmed at each end: 160 … 640 remain.
    assert value(summary, "final_return", "interquartile_mean") == 400
    assert value(summary, "final_return", "interquartile_range") == 400  # 200 to 600
    assert value(summary, "final_return", "ten_to_ninety") == 640  # 80 to 720
    assert value(summary, "final_return", "standard_deviation") == pytest.approx(80 * math.sqrt(11))
    one = summary.get("final_return", "median")
    assert one.seeds == 11
    assert 0 < one.estimate.low < 400 < one.estimate.high < 800
    assert summary.baseline is None


def test_deviation_by_episodes_is_that_of_means_of_episodes(fabric, published):
    for seed in range(3):
        # The last quarter of 40 episodes: five of 90 and five of 110, whose variance is 1000 / 9.
        fabric.run(np.resize([90.0, 110.0], 40), seed, evaluated={20_000: 0, 40_000: 500})
    by_kind = [summaries(fabric.learned(kind=kind), published) for kind in (TRAINING, EVALUATION)]
    deviations = [value(one, "final_return", BY_EPISODES) for (one,) in by_kind]
    # An evaluation has two episodes, 5 above and below its mean: a variance of 50, for a mean 25.
    assert deviations == pytest.approx([math.sqrt(1000 / 9 / 10), 5])


def test_deviation_by_episodes_is_unknown_for_single_episodes(fabric, published):
    flat(fabric, [100, 200, 300], episodes=4)  # the last quarter is one episode
    (summary,) = summarized(fabric, published)
    assert summary.get("final_return", BY_EPISODES) is None


def test_area_is_mean_over_whole_training(fabric, published):
    for seed in range(3):
        fabric.run(np.repeat([100.0, 300.0], 40), seed)
    (summary,) = summarized(fabric, published)
    assert value(summary, "area", "median") == 200
    assert value(summary, "final_return", "median") == 300


def test_seeds_that_never_reach_threshold_count_as_infinite(fabric, published):
    for seed, top in enumerate((950.0, 950.0, 600.0)):
        fabric.run(np.repeat([0.0, top], 20), seed)
    (summary,) = summarized(fabric, published)
    solved = summary.get("steps_to_solved", "median")
    assert (solved.reached, solved.seeds, solved.threshold) == (2, 3, 900)
    # The first window of 4 episodes with only returns of 950 is centered at episode 22.5.
    assert solved.estimate.value == 22_500
    assert solved.estimate.high == math.inf
    half = summary.get("steps_to_half_best", "median")
    assert half.threshold == pytest.approx(HALF_OF_THE_BEST, abs=0.1)
    assert half.reached == 3
    # Half of the best is reached where two (950) or three (600) of the window's four are late.
    assert half.estimate.value == 21_500
    assert math.isinf(summary.get("steps_to_solved", "interquartile_mean").estimate.value)


def test_ratios_are_relative_to_matching_full_cell(fabric, published):
    flat(fabric, [500 + 10 * i for i in range(10)])
    flat(fabric, [500 + 20 * i for i in range(10)], representation="dae12", encoder="e/1")
    flat(fabric, [500, 600, 700], representation="pca12", hyperparameters={"batch_size": 1})
    by_name = {s.cell.representation: s for s in summarized(fabric, published)}
    assert by_name["dae12"].baseline is by_name["full"].cell
    for spread in ("interquartile_range", "standard_deviation", "ten_to_ninety"):
        assert value(by_name["dae12"], "final_return", f"{spread}_ratio") == pytest.approx(2)
    # Other hyperparameters have no baseline and no ratio.
    assert by_name["pca12"].baseline is None
    assert by_name["pca12"].get("final_return", "standard_deviation_ratio") is None


def test_ratio_uses_episodes_common_to_all_seeds(fabric, published):
    flat(fabric, [100, 300], episodes=40)
    for seed, start in enumerate((100.0, 500.0)):
        fabric.run(np.r_[np.full(40, start), np.full(40, 999.0)], seed, representation="dae12")
    (_, reduced) = summarized(fabric, published)
    one = reduced.get("final_return", "standard_deviation_ratio")
    assert (one.estimate.value, one.control_steps) == (pytest.approx(2), 40_000)


def test_one_or_two_seeds_have_no_interval(fabric, published):
    flat(fabric, [500])
    flat(fabric, [500, 700], algo="sac")
    two, one = summarized(fabric, published)
    assert (one.cell.algo, two.cell.algo) == ("td3", "sac")
    for summary, median in ((one, 500), (two, 600)):
        found = summary.get("final_return", "median").estimate
        assert found.value == median
        assert math.isnan(found.low)
    assert one.get("final_return", "standard_deviation") is None
    assert two.get("final_return", "interquartile_range").estimate.value == 100


def test_nan_returns_are_ignored_in_means_and_counts(fabric, published):
    fabric.run([np.nan, 200.0, 400.0, 600.0], 0)
    fabric.run([100.0, 200.0, 300.0, np.nan], 1)
    (cell,) = fabric.cells()[0]
    # The last quarter of seed 1 is NaN; the area of seed 0 is the mean of three numbers.
    found = scores_of(cell, 4000)
    assert (found.final.tolist(), found.area.tolist()) == ([600.0], [400.0])
    (summary,) = summarized(fabric, published)
    assert summary.get("final_return", "median").seeds == 1


def test_seed_without_returns_is_not_counted_in_steps_to_threshold(fabric, published):
    for seed, value in enumerate((np.nan, 950.0, 950.0)):
        fabric.run(np.full(4, value), seed)
    (summary,) = summaries(fabric.learned(), published)
    for statistic in ("median", "interquartile_mean"):
        found = summary.get("steps_to_solved", statistic)
        assert (found.estimate.value, found.seeds, found.reached) == (1000, 2, 2)


def test_robot_sequence_has_no_steps_to_threshold(fabric, published):
    flat(fabric, [950, 960, 970], augment=0, robots=2)
    (summary,) = summarized(fabric, published)
    assert summary.get("steps_to_solved", "median") is None
    assert value(summary, "final_return", "median") == 960


def test_steps_of_eight_environments_are_summed(fabric, published):
    for seed in range(3):
        fabric.run(np.repeat([0.0, 950.0], 40), seed, algo="ppo", environments=8)
    (summary,) = summarized(fabric, published, window=8)
    # Episodes 41 to 48 end together after the steps of 48 episodes.
    assert value(summary, "steps_to_solved", "median") == 48_000


def test_frame_has_every_statistic_with_seeds(fabric, published):
    flat(fabric, [500, 600, 950])
    frame = statistics_frame(summarized(fabric, published))
    assert set(frame["measure"]) == {
        *("final_return", "area", "steps_to_solved", "steps_to_half_best")
    }
    assert set(frame["source"]) == {OURS}
    assert set(frame["seeds"]) == {3}
    assert set(frame["interval"]) == {"uncertainty (95% interval)"}
    solved = frame[frame["measure"] == "steps_to_solved"]
    assert set(solved["reached"]) == {1}


def test_best_published_median_is_that_at_end(published):
    assert best_at_end(published, "move_to_pose") == pytest.approx(232, abs=0.5)
    assert best_at_end(published, "my_task") is None


class TestComparisons:
    def test_only_cells_that_differ_in_one_setting_are_compared(self, fabric):
        flat(fabric, [1, 2, 3])
        flat(fabric, [1, 2, 3], representation="dae12", encoder="x")
        flat(fabric, [1, 2, 3], algo="sac", hyperparameters={"other": 1})
        flat(fabric, [1, 2, 3], engine="batched")
        flat(fabric, [1, 2, 3], task="move_to_pose", algo="sac")
        flat(fabric, [1, 2, 3], evaluate_every=7, algo="ddpg", representation="dae12")
        cells = fabric.cells()[0]
        pairs = {
            frozenset(
                (c.task, c.algo, c.representation, c.settings.engine)
                for c in (one.ours, one.theirs)
            )
            for one in within(cells)
        }
        face = "face_direction"
        assert pairs == {
            frozenset({(face, "td3", "full", "cpu"), (face, "td3", "dae12", "cpu")}),
            frozenset({(face, "td3", "full", "cpu"), (face, "sac", "full", "cpu")}),
            frozenset({(face, "td3", "full", "cpu"), (face, "td3", "full", "batched")}),
        }

    def test_variants_are_compared_with_first_of_each_algorithm(self, fabric):
        for algo in ("sac", "td3"):
            for rate in (1, 2, 3):
                flat(fabric, [1], algo=algo, hyperparameters={"rate": rate})
        pairs = [
            tuple((c.algo, c.settings.hyperparameters["rate"]) for c in (one.ours, one.theirs))
            for one in within(fabric.cells()[0])
        ]
        assert pairs == [
            *((("sac", 1), ("td3", rate)) for rate in (1, 2, 3)),
            *((("sac", rate), ("td3", 1)) for rate in (2, 3)),
            *((("sac", rate), ("sac", 1)) for rate in (2, 3)),
            *((("td3", rate), ("td3", 1)) for rate in (2, 3)),
        ]

    def test_comparison_matches_hand_computed_values(self, fabric):
        flat(fabric, [10, 20, 30, 40])
        flat(fabric, [25, 30, 50, 60], representation="dae12")
        (one,) = within(fabric.cells()[0])
        # Of 16 pairs: 25 is above two, 30 above two with one tie, 50 and 60 above all.
        assert one.improvement.value == pytest.approx((2 + 2.5 + 4 + 4) / 16)
        assert one.difference.value == pytest.approx(40 - 25)
        assert one.medians.value == pytest.approx(40 - 25)
        assert (one.seeds, one.control_steps, one.cut) == ((4, 4), 40_000, 0)

    def test_unequal_lengths_are_cut_to_common_steps(self, fabric):
        flat(fabric, [10, 20, 30], episodes=40)
        flat(fabric, [10, 20, 30], episodes=30, representation="dae12")
        (one,) = within(fabric.cells()[0])
        assert (one.control_steps, one.cut) == (30_000, 10_000)

    def test_best_cell_needs_separated_intervals(self, fabric):
        flat(fabric, np.linspace(880, 920, 8), algo="td3")
        flat(fabric, np.linspace(680, 720, 8), algo="sac")
        cells = fabric.cells()[0]
        assert best_of(cells).algo == "td3"
        flat(fabric, np.linspace(870, 915, 8), algo="ddpg")
        assert best_of(fabric.cells()[0]) is None
        assert best_of(cells[:1]) is None

    def test_five_seeds_never_mark_best_cell(self, fabric):
        flat(fabric, [900, 901, 902, 903, 904], algo="td3")
        flat(fabric, [1, 2, 3, 4, 5], algo="sac")
        assert best_of(fabric.cells()[0]) is None
