"""Tests of evaluation and training returns: cells, curves, statistics, claims and files of both."""

import numpy as np
import pyarrow as pa

from jbench.report.analysis.examine import examine
from jbench.report.analysis.scores import IQM_DIFFERENCE, PairedScores, seed_scores
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.store import schema

FLAT = np.full(40, 500.0)
RISING = {10_000: 100.0, 20_000: 300.0, 30_000: 600.0, 40_000: 950.0}


def evaluated(last):
    """Returns the mean returns of four evaluations, of which the last is `last`."""
    return {**RISING, 40_000: last}


class TestCells:
    def test_point_is_evaluation_at_its_control_steps(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, evaluated=evaluated(900.0 + 10 * seed))
        (cell,), _ = fabric.configurations(EVALUATION)
        assert cell.control_steps.tolist() == [[*RISING]] * 3
        # Each evaluation has two episodes, 5 above and 5 below its mean.
        assert cell.returns[:, 0].tolist() == [100, 100, 100]
        assert seed_scores(cell).final.tolist() == [900, 910, 920]
        assert seed_scores(cell).area[0] == (100 + 300 + 600 + 900) / 4
        (curve,) = fabric.curves(kind=EVALUATION)
        assert curve.control_steps.tolist() == [*RISING]
        assert curve.quantile(50).tolist() == [100, 300, 600, 910]
        (training,), _ = fabric.configurations(TRAINING)
        assert seed_scores(training).final.tolist() == [500] * 3
        assert training.key == cell.key

    def test_seeds_are_aligned_by_control_steps(self, fabric):
        fabric.run(FLAT, 0, evaluated={10_000: 1.0, 30_000: 3.0})
        fabric.run(FLAT, 1, evaluated={20_000: 20.0, 30_000: 30.0})
        fabric.run(FLAT, 2)
        (cell,), _ = fabric.configurations(EVALUATION)
        assert cell.seeds.tolist() == [0, 1]
        np.testing.assert_equal(cell.returns, [[1, np.nan, 3], [np.nan, 20, 30]])
        assert seed_scores(cell).final.tolist() == [3, 30]
        assert seed_scores(cell, 25_000).final.tolist() == [1, 20]
        assert cell.notes == (
            "1 of 3 seeds have no evaluation",
            "seeds were evaluated after different numbers of control steps",
        )


def test_episodes_of_kept_policies_join_last_evaluation(fabric):
    record = fabric.run(FLAT, 0, evaluated={20_000: 100.0, 40_000: 500.0})  # two episodes each
    settings = {"task": "face_direction", "policy": record.id, "episodes": 2}
    for turned, value in ((None, 600.0), (0.5, 0.0)):  # the second has a fixed target
        name = f"face_direction/policy/{value:.0f}"
        evaluation = fabric.results.create(
            "evaluation", name, {**settings, "target_yaw": turned, "seed": int(value)}
        )
        rows = [
            {"evaluation": name, "episode": i, "episode_return": value, "length": 1000}
            for i in range(2)
        ]
        evaluation.append({"policy_episodes": pa.Table.from_pylist(rows, schema.POLICY_EPISODES)})
        evaluation.finish({"median": value})
    seeds = Frames(fabric.results).seeds
    (row,) = seeds[seeds["returns"] == "evaluation"].to_dict("records")
    assert (row["final"], row["episodes"]) == (550, 4)  # of 495, 505, 600 and 600


class TestStatistics:
    def test_cells_are_compared_at_last_common_step(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, evaluated=evaluated(950.0))
            short = {10_000: 150.0, 20_000: 350.0}
            fabric.run(FLAT[:20], seed, representation="dae12", evaluated=short)
        full, encoded = fabric.configurations(EVALUATION)[0]
        one = PairedScores(encoded, full)
        assert one.control_steps == 20_000
        assert one.sample(IQM_DIFFERENCE).value == 50


class TestFrames:
    def test_verdicts_may_differ_between_returns(self, fabric):
        for seed in range(6):
            fabric.run(FLAT + seed, seed, evaluated=evaluated(950.0 + seed))
        found = Frames(fabric.results, Request(claims=True)).claims
        ours = found[(found["claim"] == "g") & (found["source"] == "own")]
        assert dict(zip(ours["returns"], ours["verdict"], strict=True)) == {
            "evaluation": "supported",
            "training": "contradicted",
        }

    def test_seeds_needed_name_power_or_six_seed_rule(self, fabric):
        for seed, final in enumerate((700.0, 800.0, 1000.0)):
            fabric.run(np.full(40, final), seed)
            fabric.run(FLAT, seed, algo="sac", evaluated=evaluated(400.0 + seed))
        needed = {f["compared"].split()[1]: f for f in examine(fabric.configurations()[0])}
        # The median of TD3 is 100 below 900 with a large spread; all seeds of SAC are equal.
        assert needed["TD3"]["seeds_needed_by"] == "80% power"
        assert needed["TD3"]["seeds_needed"] > 6
        claims = Frames(fabric.results, Request(claims=True)).claims
        # Evaluation returns of 400 to 402 are so far below 900 that power needs fewer than six.
        assert "six-seed rule" in claims["seeds_needed_by"].tolist()

    def test_frames_have_both_returns_and_lead_with_evaluations(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, algo="ddpg", evaluated=evaluated(900.0))
        fabric.run(FLAT, 0, algo="sac")
        found = Frames(fabric.results)
        assert found.returns == "evaluation"
        assert set(found.curves["returns"]) == {"evaluation", "training"}
        medians = found.configurations.set_index(["algo", "returns"])["median"].to_dict()
        assert medians == {
            ("DDPG", "evaluation"): 900,
            ("DDPG", "training"): 500,
            ("SAC", "training"): 500,
        }

    def test_runs_without_evaluations_lead_with_training(self, fabric):
        fabric.run(FLAT)
        found = Frames(fabric.results)
        assert found.returns == "training"
        assert found.runs["final"].tolist() == [500]

    def test_steps_of_unequal_runs_are_a_range(self, fabric):
        fabric.run(np.full(30, 500.0), algo="td3", status="unfinished", steps=99_000)
        fabric.run(np.full(300, 500.0), 1, algo="td3")
        (row,) = Frames(fabric.results).configurations.to_dict("records")
        assert (row["steps_min"], row["steps"]) == (30_000, 300_000)
