"""Tests of diverged runs in the report: they count with return 0 from their divergence on."""

import numpy as np

import jbench
from jbench.report.analysis.scores import seed_scores
from jbench.report.frames import Frames
from jbench.returns import EVALUATION

FLAT = np.full(40, 500.0)
LAST = {20_000: 400.0, 40_000: 600.0}


def test_diverged_seed_counts_with_zero_until_end_of_others(fabric):
    fabric.run(FLAT, 0, evaluated=LAST)
    fabric.run(FLAT[:12], 1, steps=40_000, diverged=12_400)
    fabric.run(FLAT, 2, evaluated=LAST)
    fabric.run(FLAT[:30], 3, steps=40_000, diverged=30_000, evaluated={20_000: 400.0})
    (cell,), _ = fabric.configurations()
    assert cell.returns[1].tolist() == [500.0] * 12 + [0.0] * 28
    assert cell.lengths.tolist() == [40] * 4
    assert cell.steps.tolist() == [40_000] * 4
    assert cell.diverged.tolist() == [False, True, False, True]
    assert seed_scores(cell).final.tolist() == [500, 0, 500, 0]
    assert seed_scores(cell).area[1] == 500 * 12 / 40
    assert seed_scores(cell, 12_000).final.tolist() == [500] * 4
    (curve,) = fabric.curves(window=1)
    assert curve.quantile(50)[-1] == 250  # of 0, 0, 500 and 500
    assert (curve.seeds, len(curve.control_steps)) == (4, 40)
    (cell,), _ = fabric.configurations(EVALUATION)
    assert cell.returns.tolist() == [[400, 600], [0, 0], [400, 600], [400, 0]]


def test_cell_whose_seeds_all_diverged_counts_until_requested_steps(fabric):
    fabric.run(FLAT[:10], 0, steps=40_000, diverged=10_300)
    fabric.run([], 1, steps=40_000, diverged=200)
    (cell,), notes = fabric.configurations()
    assert notes == []
    assert cell.returns.tolist() == [[500.0] * 10 + [0.0] * 30, [0.0] * 40]
    assert cell.control_steps[1, -1] == 40_000
    assert seed_scores(cell).final.tolist() == [0, 0]


def test_seeds_diverged_before_first_evaluation_have_zero_evaluations(fabric):
    for seed in range(3):
        more = {"steps": 40_000, "diverged": 1100, "evaluate_episodes": 5}
        fabric.run(FLAT[:1], seed, **more)
        fabric.run(FLAT[:1], seed, **{**more, "evaluate_episodes": 0}, algo="sac")
    (cell,), _ = fabric.configurations(EVALUATION)
    assert cell.algo == "td3"
    assert seed_scores(cell).final.tolist() == [0, 0, 0]
    assert cell.control_steps.tolist() == [[40_000]] * 3


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
    bad = fabric.run([-900.0, -1200.0, np.nan], 1, steps=40_000, diverged=3000, **task)
    (cell,), _ = fabric.configurations()
    assert cell.returns[1, 3:].tolist() == [-1200.0] * 37
    (note,) = [note for note in cell.notes if "diverged" in note]
    assert note.endswith("from its divergence on, a seed counts with its lowest training return")
    (cell,), _ = fabric.configurations(EVALUATION)
    assert cell.returns.tolist() == [[-150.0], [-1200.0]]

    opened = jbench.open(fabric.results.path)
    rows = opened.query("SELECT * FROM final_returns").set_index("run")
    names = ["evaluation_return", "evaluation_return_at_end", "training_return"]
    assert rows.loc[bad.id, names].tolist() == [-1200.0] * 3
    assert opened.runs().set_index("run").loc[bad.id, names].tolist() == [-1200.0] * 3


def test_invalid_divergence_entry_is_tolerated(fabric):
    for seed, printed in enumerate(("x", -1, [2], True, 1 << 80)):
        fabric.run(FLAT, seed, diverged=printed)
    (cell,), _ = fabric.configurations()
    assert cell.diverged.all()
    assert np.isfinite(cell.returns).all()
