"""Tests of evaluation and training returns: their curves, statistics, claims and files."""

import numpy as np
import pytest

import jbench
from jbench.report.analysis.pair import IQM_DIFFERENCE, Pair
from jbench.report.analysis.scores import seed_scores
from jbench.report.data import sources
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.returns import EVALUATION, TRAINING
from jbench.store.evaluations import added_returns
from jbench.store.listing import list_runs
from jbench.sweeps.outcomes import recorded_return

FLAT = np.full(40, 500.0)
RISING = {10_000: 100.0, 20_000: 300.0, 30_000: 600.0, 40_000: 950.0}


def evaluated(last):
    return {**RISING, 40_000: last}


def test_point_is_evaluation_at_its_control_steps(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed, evaluated=evaluated(900.0 + 10 * seed))
    (config,), _ = fabric.configurations(EVALUATION)
    assert config.control_steps.tolist() == [[*RISING]] * 3
    # Each evaluation has two episodes, 5 above and 5 below its mean.
    assert config.returns[:, 0].tolist() == [100, 100, 100]
    assert seed_scores(config).final.tolist() == [900, 910, 920]
    assert seed_scores(config).area[0] == (100 + 300 + 600 + 900) / 4
    (curve,) = fabric.curves(kind=EVALUATION)
    assert curve.control_steps.tolist() == [*RISING]
    assert curve.quantile(50).tolist() == [100, 300, 600, 910]
    (training,), _ = fabric.configurations(TRAINING)
    assert seed_scores(training).final.tolist() == [500] * 3
    assert training.runs == config.runs


def test_seeds_are_aligned_by_control_steps(fabric):
    fabric.run(FLAT, 0, evaluated={10_000: 1.0, 30_000: 3.0})
    fabric.run(FLAT, 1, evaluated={20_000: 20.0, 30_000: 30.0})
    fabric.run(FLAT, 2)
    (config,), _ = fabric.configurations(EVALUATION)
    assert config.seeds.tolist() == [0, 1]
    np.testing.assert_equal(config.returns, [[1, np.nan, 3], [np.nan, 20, 30]])
    assert seed_scores(config).final.tolist() == [3, 30]
    assert seed_scores(config, 25_000).final.tolist() == [1, 20]
    assert config.notes == (
        "1 of 3 seeds have no evaluation",
        "its seeds were logged at different control steps: the curve of evaluation returns of each "
        "is interpolated linearly between its own points",
    )


@pytest.mark.parametrize("trained", [{}, {"augment": 3, "robots": 2}])
def test_episodes_of_kept_policies_join_last_evaluation(fabric, trained):
    record = fabric.run(FLAT, 0, evaluated={20_000: 100.0, 40_000: 500.0}, **trained)
    robot = {"augment": 4} if trained else {}  # the last of the training
    fabric.evaluation(record.id, [600.0] * 2, seed=0, **robot)
    fabric.evaluation(record.id, [600.0], seed=0, states=True, **robot)  # the same episode again
    fabric.evaluation(record.id, [700.0] * 4, seed=1, **robot)
    fabric.evaluation(record.id, [0.0] * 2, seed=2, target_yaw=0.5, **robot)
    for other in ({"augment": 3}, {"augment": 5}, {} if trained else {"augment": 4}):
        fabric.evaluation(record.id, [0.0] * 2, seed=2, **other)
    fabric.evaluation("heuristic", [0.0] * 2, seed=3)
    # Of 495, 505, twice 600 and four times 700.
    assert last_returns(fabric, record) == [625] * 5
    seeds = Frames(fabric.results).seeds
    assert seeds.loc[seeds["returns"] == "evaluation", "episodes"].tolist() == [8]


def last_returns(fabric, record):
    """Returns the last evaluation return of the only run, as all parts of jbench read it."""
    added, _ = added_returns(fabric.results, {record.id: record.settings})
    (line,), _ = list_runs(fabric.results, {}, returns=True)
    seeds = Frames(fabric.results).seeds
    (opened,) = jbench.open(fabric.results.path).runs()["evaluation_return"]
    (reported,) = seeds.loc[seeds["returns"] == "evaluation", "final"]
    side = sources.side("algo=td3", "td3", fabric.results, Request())
    (config,) = (config for config in side.configurations if config.returns_name == EVALUATION)
    (beside,) = seed_scores(config).final
    compared = recorded_return(record, added=added.get(record.id, ()))
    return [opened, reported, beside, line.evaluation_return, compared]


@pytest.mark.filterwarnings("ignore:.*damaged")
def test_damaged_evaluation_is_named_and_leaves_the_runs_own_episodes(fabric):
    record = fabric.run(FLAT, 0, evaluated={20_000: 100.0, 40_000: 500.0})
    fabric.evaluation(record.id, [600.0] * 2, seed=0)
    (file,) = fabric.results.path.rglob("policy_episodes*.parquet")
    file.write_bytes(file.read_bytes()[:-9])
    assert last_returns(fabric, record) == [500] * 5
    _, (problem,) = list_runs(fabric.results, {}, returns=True)
    assert str(file.parent) in problem


def test_configurations_are_compared_at_last_common_step(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed, evaluated=evaluated(950.0))
        short = {10_000: 150.0, 20_000: 350.0}
        fabric.run(FLAT[:20], seed, representation="dae12", evaluated=short)
    full, encoded = fabric.configurations(EVALUATION)[0]
    one = Pair(encoded, full)
    assert one.control_steps == 20_000
    assert one.sample(IQM_DIFFERENCE).value == 50


def test_verdicts_may_differ_between_returns(fabric):
    for seed in range(6):
        fabric.run(FLAT + seed, seed, evaluated=evaluated(950.0 + seed))
    found = Frames(fabric.results, Request(claims=True)).claims
    ours = found[(found["claim"] == "g") & (found["source"] == "own")]
    verdicts = ours.set_index("returns")["verdict"].to_dict()
    assert verdicts == {"evaluation": "supported", "training": "contradicted"}


def test_seeds_needed_name_power_or_six_seed_rule(fabric):
    for seed, final in enumerate((700.0, 800.0, 1000.0)):
        fabric.run(np.full(40, final), seed)
        fabric.run(FLAT, seed, algo="sac", evaluated=evaluated(400.0 + seed))
    claims = Frames(fabric.results, Request(claims=True)).claims
    (td3,) = claims.query("compared == 'face_direction TD3 full' and source == 'own'").itertuples()
    # The median of TD3 is 100 below 900 with a large spread; all seeds of SAC are equal.
    assert td3.seeds_needed_by == "80% power"
    assert td3.seeds_needed > 6
    # Evaluation returns of 400 to 402 are so far below 900 that power needs fewer than six.
    assert "six-seed rule" in claims["seeds_needed_by"].tolist()


def test_frames_have_both_returns_and_lead_with_evaluations(fabric):
    fabric.flat([500] * 3, algo="ddpg", evaluated=evaluated(900.0))
    fabric.run(FLAT, 0, algo="sac")
    found = Frames(fabric.results)
    assert found.returns == "evaluation"
    assert set(found.curves["returns"]) == {"evaluation", "training"}
    medians = found.configurations.set_index(["algo", "returns"])["median"].unstack()
    assert medians.loc["DDPG"].to_dict() == {"evaluation": 900, "training": 500}
    assert medians.loc["SAC"].dropna().to_dict() == {"training": 500}


def test_runs_without_evaluations_lead_with_training(fabric):
    fabric.run(FLAT)
    found = Frames(fabric.results)
    assert found.returns == "training"
    assert found.runs["final"].tolist() == [500]


def test_band_is_of_three_seeds_that_have_returns(fabric):
    for seed, final in enumerate([300.0, 500.0, np.nan]):
        fabric.run(FLAT, seed, evaluated={20_000: final, 40_000: final})
    curves = Frames(fabric.results).curves.query("returns == 'evaluation'")
    assert curves["seeds"].tolist() == [2, 2]
    assert curves["median"].tolist() == [400, 400]
    assert curves[["q10", "q25", "q75", "q90"]].isna().all(axis=None)


def test_steps_of_unequal_runs_are_a_range(fabric):
    fabric.run(np.full(30, 500.0), algo="td3", status="unfinished", steps=99_000)
    fabric.run(np.full(300, 500.0), 1, algo="td3")
    (row,) = Frames(fabric.results).configurations.to_dict("records")
    assert (row["steps_min"], row["steps"]) == (30_000, 300_000)
