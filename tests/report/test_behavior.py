"""Tests of Figures 4 and 5: motor velocities and positions of saved states."""

import math

import numpy as np
import pandas as pd
import pytest

from jbench.policies.evaluate import evaluate
from jbench.report.figures import behavior
from jbench.settings.evaluation import EvaluationSettings
from jbench.store import Results, parquet, schema
from tests.training.small_runs import EPISODE


def behavior_of(policy="random", **changes):
    states = {
        "motor_velocity": np.array([90.0, 90.0, -90.0, 0.0], np.float32),
        "x": np.array([0.0, 0.0, 0.3, 0.3], np.float32),
        "y": np.array([0.0, 0.0, 0.3, -0.3], np.float32),
    }
    return behavior.Behavior("face_direction", policy, 100.0, 2, None, **{**states, **changes})


def test_motor_figure_shows_density_of_observed_velocities():
    figure = behavior.motor_figure("face_direction", [behavior_of()])
    (panel,) = figure.panels
    (series,) = panel.series
    # In half of the states the motor turns at 90 rad/s, observed as 0.5; bins are 0.02 wide.
    (highest,) = np.flatnonzero(np.isclose(series.y, 0.5 / 0.02))
    assert series.y.max() == series.y[highest]
    assert series.edges[highest] <= 0.5 <= series.edges[highest + 1]
    assert panel.y.log
    assert panel.x.opposite == ("rad/s", 180)


def test_position_figure_shows_share_of_states_per_bin():
    figure = behavior.position_figure("face_direction", [behavior_of(), behavior_of("heuristic")])
    assert [panel.title.splitlines()[0] for panel in figure.panels] == ["random", "heuristic"]
    heat_map = figure.panels[0].heat_map
    shares = heat_map.values[np.isfinite(heat_map.values)]
    assert sorted(shares) == pytest.approx([0.25, 0.25, 0.5])
    # Two of four states are at the origin, the corner of the four cells in the middle of 80 by 80.
    assert np.nanmax(heat_map.values[39:41, 39:41]) == 0.5


def test_worst_and_three_best_policies_are_drawn():
    ranked = [behavior_of(name)._replace(median=m) for m, name in enumerate("abcdef")]
    figures = behavior.figures([*reversed(ranked)])
    assert list(figures) == ["figure4-face_direction", "figure5-face_direction"]
    panels = figures["figure5-face_direction"].panels
    assert [panel.title.splitlines()[0] for panel in panels] == ["a", "d", "e", "f"]


def test_only_evaluations_with_saved_states_are_drawn(short_episodes, tmp_path):
    results = Results(tmp_path)
    for states in (False, True):
        settings = EvaluationSettings(
            task="move_in_direction",
            policy="constant:0.5",
            episodes=1,
            states=states,
            target_yaw=math.pi / 4,
        )
        evaluate(settings, results, threads=1)
    (found,), problems = behavior.behaviors(results)
    assert problems == []
    assert (found.policy, found.episodes, found.target_yaw) == ("constant:0.5", 1, math.pi / 4)
    assert len(found.x) == EPISODE
    assert set(behavior.figures([found])) == {
        "figure4-move_in_direction",
        "figure5-move_in_direction",
    }


def test_damaged_evaluation_is_reported(short_episodes, tmp_path):
    results = Results(tmp_path)
    settings = EvaluationSettings(task="face_direction", policy="random", episodes=1, states=True)
    record = evaluate(settings, results, threads=1)
    part = record.path / record.parts("policy_states")[0].name
    part.write_bytes(part.read_bytes()[:-1])
    found, (problem,) = behavior.behaviors(results)
    assert found == []
    assert part.name in problem


def test_evaluation_with_invalid_settings_is_reported(tmp_path):
    results = Results(tmp_path)
    record = results.create("evaluation", "a/b", {"states": True, "episodes": "many"})
    record.finish({"median": 1.0})
    found, (problem,) = behavior.behaviors(results)
    assert found == []
    assert "The evaluation a/b has invalid settings" in problem


@pytest.mark.parametrize("speeds", [[], [1.0, np.nan]])
def test_evaluation_without_finite_states_is_reported(tmp_path, speeds):
    results = Results(tmp_path)
    settings = {"task": "face_direction", "policy": "random", "episodes": 1, "states": True}
    record = results.create("evaluation", "a/b", settings)
    fields = schema.POLICY_STATES
    columns = {name: [0.0] * len(speeds) for name in fields.names} | {"motor_velocity": speeds}
    record.append({"policy_states": parquet.table_of(pd.DataFrame(columns), fields)})
    record.finish({"median": 1.0})
    found, (problem,) = behavior.behaviors(results)
    assert found == []
    assert "no states, or states that are not finite" in problem
