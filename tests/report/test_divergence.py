"""Tests of diverged runs in the report: they count with return 0 from their divergence on."""

import numpy as np
import pandas as pd
import pytest

import jbench
from jbench.report import leaderboard
from jbench.report.analysis.scores import seed_scores
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.returns import EVALUATION
from jbench.store.listing import list_runs

FLAT = np.full(40, 500.0)
LAST = {20_000: 400.0, 40_000: 600.0}


def test_diverged_seed_counts_with_zero_until_end_of_others(fabric):
    fabric.run(FLAT, 0, evaluated=LAST)
    fabric.run(FLAT[:12], 1, steps=40_000, diverged=12_400, evaluated={})
    fabric.run(FLAT, 2, evaluated=LAST)
    fabric.run(FLAT[:30], 3, steps=40_000, diverged=30_000, evaluated={20_000: 400.0})
    (config,), _ = fabric.configurations()
    assert config.returns[1].tolist() == [500.0] * 12 + [0.0] * 28
    assert config.lengths.tolist() == [40] * 4
    assert config.steps.tolist() == [40_000] * 4
    assert config.diverged.tolist() == [False, True, False, True]
    assert seed_scores(config).final.tolist() == [500, 0, 500, 0]
    assert seed_scores(config).area[1] == 500 * 12 / 40
    assert seed_scores(config, 12_000).final.tolist() == [500] * 4
    (curve,) = fabric.curves(window=1)
    assert curve.quantile(50)[-1] == 250  # of 0, 0, 500 and 500
    assert (curve.seeds, len(curve.control_steps)) == (4, 40)
    (config,), _ = fabric.configurations(EVALUATION)
    assert config.returns.tolist() == [[400, 600], [0, 0], [400, 600], [400, 0]]


def test_configuration_whose_seeds_all_diverged_counts_until_requested_steps(fabric):
    fabric.run(FLAT[:10], 0, steps=40_000, diverged=10_300)
    fabric.run([], 1, steps=40_000, diverged=200)
    (config,), notes = fabric.configurations()
    assert notes == []
    assert config.returns.tolist() == [[500.0] * 10 + [0.0] * 30, [0.0] * 40]
    assert config.control_steps[1, -1] == 40_000
    assert seed_scores(config).final.tolist() == [0, 0]


def test_seeds_diverged_before_first_evaluation_have_zero_evaluations(fabric):
    for seed in range(3):
        more = {"steps": 40_000, "diverged": 1100, "evaluate_episodes": 5}
        fabric.run(FLAT[:1], seed, **more)
        fabric.run(FLAT[:1], seed, **{**more, "evaluate_episodes": 0}, algo="sac")
    (config,), _ = fabric.configurations(EVALUATION)
    assert config.algo == "td3"
    assert seed_scores(config).final.tolist() == [0, 0, 0]
    assert config.control_steps.tolist() == [[40_000]] * 3


def test_frames_count_diverged_seeds_and_note_their_treatment(fabric):
    for seed in range(10):
        if seed in (3, 7):
            fabric.run(FLAT[:5], seed, steps=40_000, diverged=5000, evaluated={})
        else:
            fabric.run(FLAT, seed, evaluated=LAST)
    fabric.run(FLAT[:5], 0, algo="sac", status="failed", steps=40_000)
    found = Frames(fabric.results)
    (row,) = found.configurations[found.configurations["algo"] == "TD3"][:1].to_dict("records")
    assert (row["seeds"], row["diverged"]) == (10, 2)
    assert (
        "2 of 10 diverged (seed 3 after 5,000 control steps, update 7, critic_loss, seed 7 after "
        "5,000 control steps, update 7, critic_loss): from its divergence on, a seed counts with "
        "return 0, the minimum"
    ) in row["note"]
    assert "seed 3 failed" not in row["note"]
    runs = found.runs[found.runs["diverged"] != ""]
    assert sorted(runs["seed"]) == [3, 7]
    assert set(runs["diverged"]) == {"after 5,000 control steps, update 7, critic_loss"}
    assert found.seeds[found.seeds["diverged"]]["final"].tolist() == [0] * 4  # of both kinds


def test_diverged_run_counts_with_its_lowest_return_where_returns_are_negative(fabric):
    costs = np.linspace(-1600.0, -200.0, 40)
    task = {"task": "gym:Pendulum-v1"}
    fabric.run(costs, 0, evaluated={40_000: -150.0}, **task)
    costs = [-900.0, -1200.0, np.nan]
    bad = fabric.run(costs, 1, steps=40_000, diverged=3000, evaluated={}, **task)
    (config,), _ = fabric.configurations()
    assert config.returns[1, 3:].tolist() == [-1200.0] * 37
    (note,) = [note for note in config.notes if "diverged" in note]
    assert note.endswith("from its divergence on, a seed counts with its lowest training return")
    (config,), _ = fabric.configurations(EVALUATION)
    assert config.returns.tolist() == [[-150.0], [-1200.0]]

    opened = jbench.open(fabric.results.path)
    rows = opened.query("SELECT * FROM final_returns").set_index("run")
    names = ["evaluation_return", "evaluation_return_at_end", "training_return"]
    assert rows.loc[bad.id, names].tolist() == [-1200.0] * 3
    assert opened.runs().set_index("run").loc[bad.id, names].tolist() == [-1200.0] * 3


# Of a seed that diverged, by what is special: returns, settings, and what it counts with.
DIVERGED = {
    "at its last control step": (FLAT, {"diverged": 40_000, "evaluated": LAST}, 0),
    "after its last episode": (FLAT[:39], {"diverged": 39_500, "evaluated": {20_000: 400.0}}, 0),
    "later than the others end": (FLAT, {"steps": 80_000, "diverged": 60_000, "evaluated": {}}, 0),
    "before its first episode": ([], {"steps": 40_000, "diverged": 10, "evaluated": {}}, 0),
    "before its first episode of costs": (
        [],
        {"steps": 40_000, "diverged": 10, "evaluated": {}, "task": "gym:Pendulum-v1"},
        None,
    ),
    "with costs": (
        -FLAT - np.arange(40.0),
        {"diverged": 40_000, "evaluated": LAST, "task": "gym:Pendulum-v1"},
        -539,
    ),
    "in shorter episodes": (
        np.full(100, 20.0),
        {"ends": 20 * np.arange(1, 101), "steps": 40_000, "diverged": 2100, "evaluated": {}},
        0,
    ),
}


@pytest.mark.parametrize("case", DIVERGED)
def test_diverged_run_has_one_final_return_everywhere(case, fabric):
    returns, settings, counted = DIVERGED[case]
    fabric.run(FLAT, 0, evaluated=LAST, task=settings.get("task", "face_direction"))
    bad = fabric.run(returns, 1, **settings)
    assert final_returns(fabric.results, bad.id) == {counted}


def final_returns(results, run):
    """Returns the final returns of a run, of both kinds, in all tables; None if there is none."""
    opened = jbench.open(results.path)
    in_sql = opened.query(f"SELECT * FROM final_returns WHERE run = '{run}'").iloc[0]
    in_frame = opened.runs().set_index("run").loc[run]
    (line,) = list_runs(results, {"run": {run}}, returns=True)[0]
    found = [line.last_return, line.evaluation_return, line.evaluation_return_at_end]
    for row in (in_sql, in_frame):
        found += [row["training_return"], row["evaluation_return"], row["evaluation_return_at_end"]]

    return {None if pd.isna(value) else value for value in found}


@pytest.mark.parametrize("returns", ["training", "evaluation"])
def test_configuration_that_diverged_at_its_end_has_its_return_on_the_leaderboard(returns, fabric):
    for seed in range(3):
        bad = fabric.run(FLAT, seed, diverged=40_000, evaluated=LAST)

    asked = Request(returns=returns)
    table, _ = leaderboard.ranked_configurations({"results": fabric.results}, asked)
    assert table["median"][table["entry"] == "own"].tolist() == [0.0]
    assert final_returns(fabric.results, bad.id) == {0}


def test_run_without_a_whole_episode_has_its_evaluation_return(fabric):
    run = fabric.run([], steps=500, evaluated={500: 300.0})
    assert final_returns(fabric.results, run.id) == {None, 300.0}


def test_run_that_plans_no_evaluation_has_no_evaluation_return_if_it_diverges(fabric):
    fabric.run(FLAT, 0, evaluated=LAST)
    bad = fabric.run(FLAT[:5], 1, steps=40_000, diverged=5000)
    opened = jbench.open(fabric.results.path)
    rows = opened.query("SELECT * FROM final_returns").set_index("run")
    assert np.isnan(rows.loc[bad.id, "evaluation_return"])
    assert np.isnan(opened.runs().set_index("run").loc[bad.id, "evaluation_return"])


def test_diverged_seed_with_more_and_shorter_episodes_counts_until_the_end(fabric):
    fabric.run(np.full(40, 100.0), 0, task="gym:Hopper-v5")
    ends = 20 * np.arange(1, 101)
    fabric.run(np.full(100, 20.0), 1, task="gym:Hopper-v5", steps=40_000, ends=ends, diverged=2000)
    (config,), _ = fabric.configurations()
    assert config.last_step == 40_000
    # Its curve is 20 up to control step 2,000, and then 0.
    assert seed_scores(config).area[1] == pytest.approx(20 * 1000 / 39_000, rel=0.05)
    (note,) = [note for note in config.notes if "diverged" in note]
    assert note.endswith("counts with return 0, which is lower than its returns")


def test_note_says_of_each_seed_what_it_counts_with(fabric):
    task = {"task": "gym:Pendulum-v1", "steps": 40_000}
    fabric.run([-900.0, -1200.0], 0, diverged=2000, **task)
    fabric.run([5.0, 3.0], 1, diverged=2000, **task)
    (config,), _ = fabric.configurations()
    (note,) = [note for note in config.notes if "diverged" in note]
    assert note.endswith(
        "a seed counts with its lowest training return (seed 1: 0, which is lower)"
    )


def test_run_without_any_return_is_named_and_left_out(fabric):
    fabric.run(-FLAT, 0, task="gym:Pendulum-v1")
    bad = fabric.run([], 1, steps=40_000, diverged=10, task="gym:Pendulum-v1")
    (config,), notes = fabric.configurations()
    assert config.seeds.tolist() == [0]
    assert notes == [
        f"The run {bad.id} diverged before its first episode ended, so it has no return; it is "
        "left out, and its configuration looks better than it is."
    ]


def test_invalid_divergence_entry_is_tolerated(fabric):
    for seed, printed in enumerate(("x", -1, [2], True, 1 << 80)):
        fabric.run(FLAT, seed, diverged=printed)
    (config,), _ = fabric.configurations()
    assert config.diverged.all()
    assert np.isfinite(config.returns).all()
