"""Tests of the statistics and comparisons of cells against hand-computed numbers."""

import math

import numpy as np
import pytest

from jbench.report.analysis.compare import pair_frame
from jbench.report.analysis.scores import IQM_DIFFERENCE, PairedScores, seed_scores
from jbench.report.configurations import configuration_frame
from jbench.report.data.published import read_published
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.statistics import bootstrap as st
from jbench.store import query


def flat(fabric, finals, episodes=40, **settings):
    """Adds a run of constant returns for each seed."""
    for seed, final in enumerate(finals):
        fabric.run(np.full(episodes, float(final)), seed, **settings)


def summarized(fabric, window=4, kind=TRAINING):
    cells = fabric.configurations(kind)[0]
    curves = [(cell, cell.curve(window=window)) for cell in cells]
    return configuration_frame(curves, read_published(query.published())).to_dict("records")


def test_location_and_spread_match_hand_computed_values(fabric):
    flat(fabric, range(0, 880, 80))  # 0, 80, … 800: eleven seeds
    (row,) = summarized(fabric)
    assert row["median"] == 400
    # Two of eleven seeds are trimmed at each end: 160 … 640 remain.
    assert row["iqm"] == 400
    assert row["deviation"] == pytest.approx(80 * math.sqrt(11))
    assert 0 < row["median_low"] < 400 < row["median_high"] < 800


def test_deviation_by_episodes_is_that_of_means_of_episodes(fabric):
    for seed in range(3):
        # The last quarter of 40 episodes: five of 90 and five of 110, whose variance is 1000 / 9.
        fabric.run(np.resize([90.0, 110.0], 40), seed, evaluated={20_000: 0, 40_000: 500})
    by_kind = [summarized(fabric, kind=kind) for kind in (TRAINING, EVALUATION)]
    deviations = [row["deviation_by_episodes"] for (row,) in by_kind]
    # An evaluation has two episodes, 5 above and below its mean: a variance of 50, for a mean 25.
    assert deviations == pytest.approx([math.sqrt(1000 / 9 / 10), 5])


def test_return_over_run_is_mean_over_whole_training(fabric):
    for seed in range(3):
        fabric.run(np.repeat([100.0, 300.0], 40), seed)
    (row,) = summarized(fabric)
    assert (row["over_run"], row["median"]) == (200, 300)


def test_seeds_that_never_reach_return_count_as_infinite(fabric):
    for seed, top in enumerate((950.0, 950.0, 600.0)):
        fabric.run(np.repeat([0.0, top], 20), seed)
    (row,) = summarized(fabric)
    assert row["reached"] == 2
    # The first window of 4 episodes with only returns of 950 is centered at episode 22.5.
    assert row["solved_steps"] == 22_500
    assert row["solved_steps_high"] == math.inf


def test_nan_returns_are_ignored_in_means_and_counts(fabric):
    fabric.run([np.nan, 200.0, 400.0, 600.0], 0)
    fabric.run([100.0, 200.0, 300.0, np.nan], 1)
    (cell,) = fabric.configurations()[0]
    # The last quarter of seed 1 is NaN; the area of seed 0 is the mean of three numbers.
    found = seed_scores(cell, 4000)
    assert (found.final.tolist(), found.area.tolist()) == ([600.0], [400.0])
    assert found.known.tolist() == [True, False]


def test_frame_says_what_is_solved(fabric, published):
    flat(fabric, [950, 960, 970, 980, 990, 995])
    flat(fabric, [300, 310, 320, 330, 340, 350], algo="sac")
    flat(fabric, [950, 960, 970], algo="ddpg")
    cells = fabric.configurations()[0]
    frame = configuration_frame([(cell, cell.curve()) for cell in cells], published)
    assert dict(zip(frame["algo"], frame["solved"], strict=True)) == {
        "DDPG": "undecided",
        "SAC": "no",
        "TD3": "yes",
    }
    assert frame["published_figure"].tolist() == [None] * 3  # which begins later


class TestComparisons:
    def test_configurations_trained_equally_long_are_paired(self, fabric):
        for representation in ("full", "dae12"):
            flat(fabric, range(100, 700, 100), representation=representation)
        flat(fabric, range(100, 700, 100), algo="sac", episodes=80)
        flat(fabric, [1, 2, 3, 4, 5], algo="ddpg")
        found = pair_frame(fabric.configurations()[0])
        assert list(found["a_label"]) == ["TD3 full", "TD3 dae12"]
        assert list(found["p"]) == [0.5, 0.5]
        assert not found["decided"].any()

    def test_comparison_matches_hand_computed_values(self, fabric):
        flat(fabric, [10, 20, 30, 40])
        flat(fabric, [25, 30, 50, 60], representation="dae12")
        full, encoded = fabric.configurations()[0]
        one = PairedScores(encoded, full)
        # Of 16 pairs: 25 is above two, 30 above two with one tie, 50 and 60 above all.
        probability = one.sample(st.probability_of_improvement).value
        assert probability == pytest.approx((2 + 2.5 + 4 + 4) / 16)
        assert one.sample(IQM_DIFFERENCE).value == pytest.approx(40 - 25)
        assert one.sample(st.difference(st.median)).value == pytest.approx(40 - 25)
        assert (one.seeds, one.control_steps) == (4, 40_000)
