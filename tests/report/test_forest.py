"""The forest plot and the sentence of the first screen."""

import re

import numpy as np

from jbench.report import contents
from jbench.report.analysis import statistics as st
from jbench.report.report import gather
from jbench.report.request import Request

ROWS = ["DDPG", "SAC"]


def ran(fabric, finals, **settings):
    for seed, final in enumerate(finals):
        fabric.run(np.full(40, float(final)), seed, **settings)


def document(fabric):
    return contents.document(gather(fabric.results, Request()))


def forest(fabric):
    (item,) = [item for item in document(fabric).overview if item.name == "forest"]
    return item.figure


def means(panel):
    """Returns the interquartile mean and its interval by row of a panel."""
    found = {}
    for series in panel.series:
        if series.entries == ("interquartile mean, 95% interval",):
            band = [(float(b.low[0]), float(b.high[0])) for b in series.bands]
            found[panel.y.names[int(series.y[0])]] = (float(series.x[0]), band)
    return found


class TestForest:
    def test_a_row_has_its_mean_its_interval_and_its_seeds(self, fabric):
        finals = [700, 800, 820, 840, 860, 990]
        ran(fabric, finals, algo="sac")
        ran(fabric, [500, 600], algo="ddpg")
        (panel,) = forest(fabric).panels
        assert panel.y.names == ROWS
        found = means(panel)
        # Of six seeds, one is left out at each end; two have no interval.
        assert found["SAC"][0] == 830
        assert found["DDPG"] == (550, [])
        expected = st.estimate(st.interquartile_mean, [np.array(finals, float)])
        assert found["SAC"][1] == [(expected.low, expected.high)]
        (dots,) = [s for s in panel.series if s.entries == ("one seed",) and s.y[0] > 1]
        assert sorted(dots.x) == finals

    def test_the_published_median_is_dashed_in_its_row(self, fabric):
        for seed in range(3):
            fabric.run(np.full(300, 500.0), seed, algo="sac")
        (panel,) = forest(fabric).panels
        (dashed,) = [series for series in panel.series if series.style.dash == "--"]
        # SAC on face_direction has learned it by then (Figure 9).
        assert dashed.x[0] == dashed.x[1] > 900
        assert dashed.y.mean() == 0

    def test_all_tasks_count_the_same_and_need_runs_on_each(self, fabric):
        ran(fabric, [900, 900, 900], algo="sac")
        ran(fabric, [300, 300, 300], algo="sac", task="move_to_pose")
        ran(fabric, [500, 500, 500], algo="ddpg")
        panels = forest(fabric).panels
        assert [panel.title for panel in panels] == ["face_direction", "move_to_pose", "all tasks"]
        # Of the six runs at 900 and 300, one of each is left out; a resample draws within a task.
        assert means(panels[2]) == {"SAC": (600, [(600, 600)])}


class TestLearningCurvesOfTheOverview:
    def test_the_title_says_that_encoded_observations_are_elsewhere(self, fabric):
        ran(fabric, [800, 810])
        assert document(fabric).overview[0].title.startswith("Learning curves: ")
        ran(fabric, [500, 510], representation="dae12")
        title = document(fabric).overview[0].title
        assert title.startswith("Learning curves on the full observation: ")

    def test_the_title_names_no_observation_if_one_is_encoded(self, fabric):
        ran(fabric, [800, 810])
        ran(fabric, [500, 510], representation="dae12")
        ran(fabric, [500, 510], algo="sac", representation="dae12")
        assert document(fabric).overview[0].title.startswith("Learning curves: ")


class TestHeadline:
    def test_it_says_who_solves_what_by_when(self, fabric):
        ran(fabric, [950 + seed for seed in range(6)], algo="sac")
        ran(fabric, [300 + seed for seed in range(6)], algo="ppo")
        said = document(fabric).headline
        assert said.startswith("SAC solves face_direction (median return 952; 900 after ")
        assert "PPO does not solve face_direction (median return 302; 6 seeds)" in said

    def test_few_seeds_decide_nothing(self, fabric):
        ran(fabric, [950, 960, 970], algo="sac")
        assert document(fabric).headline.startswith(
            "Whether SAC solves face_direction is undecided (median return 960; 900 after "
        )
        assert document(fabric).headline.endswith("; 3 seeds). (These are training returns.)")

    def test_cells_with_few_seeds_are_left_out_beside_those_with_enough(self, fabric):
        ran(fabric, [300 + seed for seed in range(6)], algo="ppo")
        ran(fabric, [950, 960, 970], algo="sac")
        assert document(fabric).headline == (
            "PPO does not solve face_direction (median return 302; 6 seeds). "
            "(These are training returns.)"
        )

    def test_tasks_with_the_same_answer_share_a_clause(self, fabric):
        for task in ("face_direction", "move_to_pose"):
            ran(fabric, [300 + seed for seed in range(6)], task=task)
        assert document(fabric).headline == (
            "TD3 does not solve face_direction and move_to_pose (median returns 302; 6 seeds "
            "each). (These are training returns.)"
        )

    def test_what_reduction_costs(self, fabric):
        ran(fabric, [800 + seed for seed in range(6)])
        ran(fabric, [500 + seed for seed in range(6)], representation="dae12")
        ran(fabric, [700 + seed for seed in range(6)], algo="sac")
        ran(fabric, [500 + seed for seed in range(6)], algo="sac", representation="dae12")
        said = document(fabric).headline
        # The first sentence is the answer to the paper's question, for both algorithms.
        assert re.match(
            r"On face_direction, agents end lower with dae12 than with the full observation "
            r"\(dae12: SAC -200 \[.*\], TD3 -300 \[.*\]; 90% intervals; 6 seeds\)\. "
            r"SAC and TD3 do not solve",
            said,
        )

    def test_variants_are_named(self, fabric):
        for engine, lower in (("batched", 300), ("sb3", 100)):
            ran(fabric, [800 + seed for seed in range(6)], engine=engine)
            finals = [800 - lower + seed for seed in range(6)]
            ran(fabric, finals, representation="dae12", engine=engine)
        said = document(fabric).headline
        assert re.search(r"\(dae12: TD3 -300 \[.*\], TD3 stable-baselines3 -100 \[", said)

    def test_representations_with_one_outcome_share_a_sentence(self, fabric):
        ends = {"full": 800, "dae12": 500, "pca4": 300, "planar12": 805}
        for representation, final in ends.items():
            ran(fabric, [final + seed for seed in range(6)], representation=representation)
        lower, similar, _ = document(fabric).headline.split(". ", 2)
        assert "agents end lower with dae12 or pca4 than with" in lower
        assert re.search(r"\(dae12: TD3 -300 \[.*\]; pca4: TD3 -500 \[", lower)
        assert "agents end similarly with planar12 and with" in similar

    def test_a_faster_representation_is_named_even_if_its_final_return_is_undecided(self, fabric):
        for seed, final in enumerate(range(700, 940, 40)):
            for representation, early in (("full", 100), ("dae12", 700)):
                returns = [early] * 6 + [final] * 2
                fabric.run(returns, seed, algo="td3", representation=representation)
        said = document(fabric).headline
        # 600 more in six of eight episodes.
        assert said.startswith(
            "On face_direction, agents learn faster with dae12 than with the full observation; "
            "whether they end similarly is undecided (dae12: TD3 +450 ["
        )
        assert "]; means over the run, 95% interval; 6 seeds)." in said

    def test_an_interval_is_named_only_if_there_is_one(self, fabric):
        ran(fabric, [800 + seed for seed in range(6)])
        ran(fabric, [820], representation="dae12")
        said = document(fabric).headline
        assert "similarly with dae12 and with the full observation (dae12: TD3 +18; 1" in said

    def test_the_inventory_counts_runs_settings_tasks_and_steps(self, fabric):
        ran(fabric, [500, 600])
        ran(fabric, [500], algo="sac", task="move_to_pose")
        assert document(fabric).inventory == [
            ("3", "runs"),
            ("2", "settings"),
            ("2", "tasks"),
            ("120k", "control steps"),
        ]
