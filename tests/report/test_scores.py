"""Tests of the statistics and comparisons of configurations against hand-computed numbers."""

import math

import numpy as np
import pandas as pd
import pytest

from jbench.report.analysis import compare, pair
from jbench.report.analysis.compare import pair_frame
from jbench.report.analysis.pair import Pair
from jbench.report.analysis.scores import seed_scores
from jbench.report.analysis.verdicts import VERDICTS
from jbench.report.configurations import configuration_frame
from jbench.report.data.curves import read_published
from jbench.report.encoders import return_frame
from jbench.returns import EVALUATION, TRAINING
from jbench.store.tables import published_rows


def summarized(fabric, window=4, kind=TRAINING):
    configurations = fabric.configurations(kind)[0]
    curves = [(config, config.curve(window=window)) for config in configurations]
    return configuration_frame(curves, read_published(published_rows())).to_dict("records")


def test_location_and_spread_match_hand_computed_values(fabric):
    fabric.flat(range(0, 880, 80))  # 0, 80, … 800: eleven seeds
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


def test_seeds_that_never_reach_return_count_as_infinite(fabric):
    for seed, top in enumerate((950.0, 950.0, 600.0)):
        fabric.run(np.repeat([0.0, top], 20), seed)
    (row,) = summarized(fabric)
    assert row["reached"] == 2
    # The first window of 4 episodes with only returns of 950 is centered at episode 22.5.
    assert row["solved_steps"] == 22_500
    assert row["solved_steps_high"] == math.inf


def test_nan_returns_are_left_out_of_means_and_counts(fabric):
    fabric.run([np.nan, 200.0, 400.0, 600.0, 200.0, 400.0, np.nan, 600.0], 0)
    fabric.run([100.0] * 6 + [np.nan] * 2, 1)
    (config,) = fabric.configurations()[0]
    # The last quarter of seed 1 is NaN. Both have returns from 2,000 to 6,000 control steps, where
    # the lines between those of seed 0 have the means 300, 500, 400 and 300.
    found = seed_scores(config, 8000)
    assert (found.final.tolist(), found.area.tolist()) == ([600.0], [pytest.approx(375, abs=0.2)])
    assert found.known.tolist() == [True, False]


def test_frame_says_what_is_solved(fabric):
    fabric.flat([950, 960, 970, 980, 990, 995])
    fabric.flat([300, 310, 320, 330, 340, 350], algo="sac")
    fabric.flat([950, 960, 970], algo="ddpg")
    solved = {row["algo"]: row["solved"] for row in summarized(fabric)}
    assert solved == {"DDPG": "undecided", "SAC": "no", "TD3": "yes"}


def test_configurations_trained_equally_long_are_paired(fabric, monkeypatch):
    for representation in ("full", "dae12"):
        fabric.flat(range(100, 700, 100), representation=representation)
    fabric.flat(range(100, 700, 100), algo="sac", episodes=80)
    fabric.flat([1, 2, 3, 4, 5], algo="ddpg")
    scored = []
    monkeypatch.setattr(pair, "mean_returns", None)  # means over the run are not compared
    monkeypatch.setattr(compare, "Pair", lambda *sides: scored.append(sides) or Pair(*sides))
    found = pair_frame(fabric.configurations()[0], pd.DataFrame(columns=VERDICTS))
    assert list(found["a_label"]) == ["TD3 full", "TD3 dae12"]
    assert len(scored) == 1  # of six pairs: a report of 3,000 runs has 100,000
    assert list(found["p"]) == [0.5, 0.5]
    assert not found["decided"].any()


def test_agents_whose_last_episodes_end_at_different_steps_are_paired(fabric):
    # All are trained for 2,000 control steps; their last episodes end 0 to 25 steps before.
    for place, representation in enumerate(("full", "scaled11", "pca4")):
        for seed in range(6):
            ends = np.arange(50, 2001, 50) - 10 * place - seed
            names = {"task": "gym:Hopper-v5", "representation": representation}
            fabric.run(np.full(40, 100.0 * place), seed, steps=2000, ends=ends, **names)

    configurations = fabric.configurations()[0]
    pairs = pair_frame(configurations, pd.DataFrame(columns=VERDICTS))
    found = pairs.set_index(["a_label", "b_label"])["p"].to_dict()
    names = ["TD3 full", "TD3 scaled", "TD3 pca4"]
    assert found == {
        (a, b): float(i > j) for i, a in enumerate(names) for j, b in enumerate(names) if a != b
    }
    finals = return_frame(configurations).set_index("representation")["iqm"]
    assert finals.to_dict() == {"full": 0.0, "scaled": 100.0, "pca4": 200.0}
