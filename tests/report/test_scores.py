"""Statistics of a cell's seeds, worked out by hand."""

import math

import numpy as np
import pytest

from jbench.report.analysis.comparisons import best_of, within
from jbench.report.analysis.scores import scores_of, statistics_frame, summaries
from jbench.report.data.published import best_at_end
from jbench.report.sources import OURS

HALF_OF_THE_BEST = 963.4 / 2  # TD3 on face_direction, Figure 9


def flat(fabric, finals, episodes=40, **settings):
    """Adds a run for each seed whose every return is the same."""
    for seed, final in enumerate(finals):
        fabric.run(np.full(episodes, float(final)), seed, **settings)


def summarised(fabric, published, window=4):
    return summaries(fabric.learned(window=window), published)


def value(summary, measure, statistic):
    return summary.get(measure, statistic).estimate.value


def test_location_and_spread_by_hand(fabric, published):
    flat(fabric, range(0, 880, 80))  # 0, 80, … 800: eleven seeds
    (summary,) = summarised(fabric, published)
    assert value(summary, "final_return", "median") == 400
    # A quarter of eleven is two at each end: 160 … 640.
    assert value(summary, "final_return", "interquartile_mean") == 400
    assert value(summary, "final_return", "interquartile_range") == 400  # 200 to 600
    assert value(summary, "final_return", "ten_to_ninety") == 640  # 80 to 720
    assert value(summary, "final_return", "standard_deviation") == pytest.approx(80 * math.sqrt(11))
    one = summary.get("final_return", "median")
    assert one.seeds == 11
    assert 0 < one.estimate.low < 400 < one.estimate.high < 800
    assert summary.baseline is None


def test_the_area_is_the_mean_over_training_and_the_final_return_that_of_its_end(fabric, published):
    for seed in range(3):
        fabric.run(np.repeat([100.0, 300.0], 40), seed)
    (summary,) = summarised(fabric, published)
    assert value(summary, "area", "median") == 200
    assert value(summary, "final_return", "median") == 300


def test_seeds_that_never_get_there_are_kept_as_later_than_all_others(fabric, published):
    for seed, top in enumerate((950.0, 950.0, 600.0)):
        fabric.run(np.repeat([0.0, top], 20), seed)
    (summary,) = summarised(fabric, published)
    solved = summary.get("steps_to_solved", "median")
    assert (solved.reached, solved.seeds, solved.threshold) == (2, 3, 900)
    # The window of 4 episodes that is the first to hold only the 950s: centred at episode 22.5.
    assert solved.estimate.value == 22_500
    assert solved.estimate.high == math.inf
    half = summary.get("steps_to_half_best", "median")
    assert half.threshold == pytest.approx(HALF_OF_THE_BEST, abs=0.1)
    assert half.reached == 3
    # Half of the best is in the window where two (950) or three of four (600) are late returns.
    assert half.estimate.value == 21_500
    assert math.isinf(summary.get("steps_to_solved", "interquartile_mean").estimate.value)


def test_ratios_are_to_the_same_runs_on_the_full_observation(fabric, published):
    flat(fabric, [500 + 10 * i for i in range(10)])
    flat(fabric, [500 + 20 * i for i in range(10)], representation="dae12", encoder="e/1")
    flat(fabric, [500, 600, 700], representation="pca12", hyperparameters={"batch_size": 1})
    by_name = {s.cell.representation: s for s in summarised(fabric, published)}
    assert by_name["dae12"].baseline is by_name["full"].cell
    for spread in ("interquartile_range", "standard_deviation", "ten_to_ninety"):
        assert value(by_name["dae12"], "final_return", f"{spread}_ratio") == pytest.approx(2)
    # Of other hyperparameters: no baseline, so no ratio.
    assert by_name["pca12"].baseline is None
    assert by_name["pca12"].get("final_return", "standard_deviation_ratio") is None


def test_a_ratio_is_over_the_episodes_that_all_seeds_have(fabric, published):
    flat(fabric, [100, 300], episodes=40)
    for seed, start in enumerate((100.0, 500.0)):
        fabric.run(np.r_[np.full(40, start), np.full(40, 999.0)], seed, representation="dae12")
    (_, reduced) = summarised(fabric, published)
    one = reduced.get("final_return", "standard_deviation_ratio")
    assert (one.estimate.value, one.control_steps) == (pytest.approx(2), 40_000)


def test_one_and_two_seeds_have_no_interval_and_one_no_spread(fabric, published):
    flat(fabric, [500])
    flat(fabric, [500, 700], algo="sac")
    two, one = summarised(fabric, published)
    assert (one.cell.algo, two.cell.algo) == ("td3", "sac")
    for summary, median in ((one, 500), (two, 600)):
        found = summary.get("final_return", "median").estimate
        assert found.value == median
        assert math.isnan(found.low)
    assert one.get("final_return", "standard_deviation") is None
    assert two.get("final_return", "interquartile_range").estimate.value == 100


def test_returns_that_are_no_numbers_are_left_out_of_means_and_a_seed_without_any_of_n(
    fabric, published
):
    fabric.run([np.nan, 200.0, 400.0, 600.0], 0)
    fabric.run([100.0, 200.0, 300.0, np.nan], 1)
    (cell,) = fabric.cells()[0]
    # The last quarter of seed 1 holds no number; the area of seed 0 is of three numbers.
    found = scores_of(cell, 4000)
    assert (found.final.tolist(), found.area.tolist()) == ([600.0], [400.0])
    (summary,) = summarised(fabric, published)
    assert summary.get("final_return", "median").seeds == 1


def test_robots_in_turn_have_no_steps_to_a_return(fabric, published):
    flat(fabric, [950, 960, 970], augment=0, robots=2)
    (summary,) = summarised(fabric, published)
    assert summary.get("steps_to_solved", "median") is None
    assert value(summary, "final_return", "median") == 960


def test_the_steps_of_eight_environments_are_counted_over_all(fabric, published):
    for seed in range(3):
        fabric.run(np.repeat([0.0, 950.0], 40), seed, algo="ppo", environments=8)
    (summary,) = summarised(fabric, published, window=8)
    # The 41st to 48th episode end together after 48 episodes' steps, whatever their order.
    assert value(summary, "steps_to_solved", "median") == 48_000


def test_the_frame_holds_every_statistic_with_its_n(fabric, published):
    flat(fabric, [500, 600, 950])
    frame = statistics_frame(summarised(fabric, published))
    assert set(frame["measure"]) == {
        *("final_return", "area", "steps_to_solved", "steps_to_half_best")
    }
    assert set(frame["source"]) == {OURS}
    assert set(frame["seeds"]) == {3}
    assert set(frame["interval"]) == {"uncertainty (95% interval)"}
    solved = frame[frame["measure"] == "steps_to_solved"]
    assert set(solved["reached"]) == {1}


def test_the_best_published_median_of_a_task_is_that_at_the_end(published):
    assert best_at_end(published, "move_to_pose") == pytest.approx(232, abs=0.5)
    assert best_at_end(published, "my_task") is None


class TestComparisons:
    def test_only_what_differs_in_one_thing_is_compared(self, fabric):
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

    def test_variants_are_paired_with_the_first_of_another_algorithm_and_of_their_own(self, fabric):
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

    def test_the_numbers_by_hand(self, fabric):
        flat(fabric, [10, 20, 30, 40])
        flat(fabric, [25, 30, 50, 60], representation="dae12")
        (one,) = within(fabric.cells()[0])
        # Of 16 pairs: 25 beats two, 30 two and ties with one, 50 and 60 all.
        assert one.improvement.value == pytest.approx((2 + 2.5 + 4 + 4) / 16)
        assert one.difference.value == pytest.approx(40 - 25)
        assert one.medians.value == pytest.approx(40 - 25)
        assert (one.seeds, one.control_steps, one.cut) == ((4, 4), 40_000, 0)

    def test_unequal_lengths_are_cut_to_what_all_have_and_it_is_said(self, fabric):
        flat(fabric, [10, 20, 30], episodes=40)
        flat(fabric, [10, 20, 30], episodes=30, representation="dae12")
        (one,) = within(fabric.cells()[0])
        assert (one.control_steps, one.cut) == (30_000, 10_000)

    def test_the_best_is_named_only_where_every_interval_says_so(self, fabric):
        flat(fabric, np.linspace(880, 920, 8), algo="td3")
        flat(fabric, np.linspace(680, 720, 8), algo="sac")
        cells = fabric.cells()[0]
        assert best_of(cells).algo == "td3"
        flat(fabric, np.linspace(870, 915, 8), algo="ddpg")
        assert best_of(fabric.cells()[0]) is None
        assert best_of(cells[:1]) is None

    def test_five_seeds_name_no_best_however_far_ahead(self, fabric):
        flat(fabric, [900, 901, 902, 903, 904], algo="td3")
        flat(fabric, [1, 2, 3, 4, 5], algo="sac")
        assert best_of(fabric.cells()[0]) is None
