"""Tests of curves on robot sequences: returns are averaged within each robot's episodes."""

import numpy as np

from jbench.report.frames import Frames

SAC = {"algo": "sac", "task": "move_in_direction", "augment": 0, "robots": 2}
# Two robots of 80 episodes: 80 returns of 100, then 80 of 300.
RETURNS = np.repeat([100.0, 300.0], 80)


def test_windows_never_span_change_of_robots(fabric):
    for seed in range(3):
        fabric.run(RETURNS + seed, seed, **SAC)
    (config,), _ = fabric.configurations()
    assert (config.robots, config.robot_episodes) == (2, 80)
    curve = config.curve()
    # Each robot's 80 episodes have 61 full windows of 20, and 10 truncated ones at each end; the
    # median of seeds 0, 1 and 2 adds 1.
    assert curve.window == 20
    assert curve.quantile(50).tolist() == [101.0] * 81 + [301.0] * 81
    # From the first to the last episode of each robot.
    assert curve.control_steps[[0, 80, 81, 161]].tolist() == [1000, 80_000, 81_000, 160_000]
    assert curve.widths[[0, 9, 10, 80, 81]].tolist() == [10, 19, 20, 10, 10]


def test_run_on_first_robot_uses_planned_changes(fabric):
    fabric.run(RETURNS[:40], 0, status="unfinished", steps=160_000, **SAC)
    (config,), _ = fabric.configurations()
    assert config.robot_episodes == 80
    assert config.curve("smooth-first").quantile(50).tolist() == [100.0] * 41


def test_sequences_stand_beside_the_authors_and_apart_from_single_robots(fabric):
    fabric.run(RETURNS, 0, **SAC)
    fabric.run(RETURNS, 0, **{**SAC, "augment": None, "robots": 1})
    found = Frames(fabric.results)
    own = found.sequences[found.sequences["source"] == "own"]
    assert set(own["robots"]) == {2}
    assert set(own["robot_steps"]) == {80_000}
    assert set(own["window"]) == {*range(10, 21)}
    theirs = found.sequences[found.sequences["source"] == "published"]
    assert set(theirs["robots"]) == {10}
    assert theirs["steps"].max() <= 160_000
    # Runs on one robot are in other figures.
    assert len(found.curves["configuration"].unique()) == 1
    assert "augmented SAC" not in set(found.published["figure"])
