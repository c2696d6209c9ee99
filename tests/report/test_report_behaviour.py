"""Figures 4 and 5 show the states that were kept, and only those."""

import math

import numpy as np
import pytest

from jbench.experiments.evaluate import EvaluationSettings, evaluate
from jbench.report import behaviour
from jbench.store import Results


def made_up(policy="random", **changes):
    states = {
        "motor_velocity": np.array([90.0, 90.0, -90.0, 0.0], np.float32),
        "x": np.array([0.0, 0.0, 0.3, 0.3], np.float32),
        "y": np.array([0.0, 0.0, 0.3, -0.3], np.float32),
    }
    return behaviour.Behaviour("face_direction", policy, 100.0, 2, None, **{**states, **changes})


def test_motor_velocities_are_shown_as_observed_as_a_density():
    figure = behaviour.motor_figure("face_direction", [made_up()])
    (axes,) = figure.axes
    (outline,) = axes.patches
    corners = outline.get_xy()
    # Half of the states turn at 90 rad/s, which is observed as 0.5; bins are 0.02 wide.
    heights = {round(float(h), 6) for _, h in corners}
    assert max(heights) == pytest.approx(0.5 / 0.02)
    highest = corners[np.isclose(corners[:, 1], 0.5 / 0.02)][:, 0]
    assert highest.min() <= 0.5 <= highest.max()


def test_positions_are_shares_of_all_states_in_their_cells():
    figure = behaviour.position_figure("face_direction", [made_up(), made_up("heuristic")])
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left").splitlines()[0] for axes in panels] == [
        "random",
        "heuristic",
    ]
    (mesh,) = (c for c in panels[0].collections)
    shares = mesh.get_array().compressed()
    assert sorted(shares) == pytest.approx([0.25, 0.25, 0.5])


def test_the_worst_and_the_best_are_drawn():
    ranked = [made_up(name)._replace(median=m) for m, name in enumerate("abcdef")]
    figures = behaviour.draw([*reversed(ranked)])
    assert list(figures) == ["figure4-face_direction", "figure5-face_direction"]
    panels = [axes.get_title(loc="left") for axes in figures["figure5-face_direction"].axes]
    assert [title.splitlines()[0] for title in panels if title] == ["a", "d", "e", "f"]


def test_only_evaluations_with_states_are_drawn(tmp_path):
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
    (found,), problems = behaviour.behaviours(results)
    assert problems == []
    assert (found.policy, found.episodes, found.target_yaw) == ("constant:0.5", 1, math.pi / 4)
    assert len(found.x) == 1000
    assert set(behaviour.draw([found])) == {
        "figure4-move_in_direction",
        "figure5-move_in_direction",
    }


def test_a_damaged_evaluation_is_named(tmp_path):
    results = Results(tmp_path)
    settings = EvaluationSettings(task="face_direction", policy="random", episodes=1, states=True)
    record = evaluate(settings, results, threads=1)
    part = record.path / record.parts("policy_states")[0].name
    part.write_bytes(part.read_bytes()[:-1])
    found, (problem,) = behaviour.behaviours(results)
    assert found == []
    assert part.name in problem


def test_an_evaluation_with_impossible_settings_is_named(tmp_path):
    results = Results(tmp_path)
    record = results.create("evaluation", "a/b", {"states": True, "episodes": "many"})
    record.finish({"median": 1.0})
    found, (problem,) = behaviour.behaviours(results)
    assert found == []
    assert "The evaluation a/b has settings that can't be" in problem
