"""Tests of Figures 4 and 5: motor velocities and positions of saved states."""

import numpy as np
import pandas as pd
import pytest

from jbench.report.policies import behavior
from jbench.store import Results, record_files, schema

STATES = {
    "motor_velocity": [90.0, 90.0, -90.0, 0.0],
    "x": [0.0, 0.0, 0.3, 0.3],
    "y": [0.0, 0.0, 0.3, -0.3],
}


def add(results, policy, median=100.0, states=STATES, **more):
    """Adds a finished evaluation with these states, or without any saved."""
    settings = {"task": "face_direction", "policy": policy, "episodes": 2, **more}
    settings["states"] = states is not None
    record = results.create("evaluation", f"face_direction/{policy}", settings)
    if states is not None:
        columns = {
            name: [0.0] * len(states["x"]) for name in schema.FILES["policy_states"].names
        } | states
        rows = record_files.to_table(pd.DataFrame(columns), schema.FILES["policy_states"])
        record.append({"policy_states": rows})
    record.finish({"median": median})


def test_frames_have_densities_of_velocities_and_shares_of_squares(tmp_path):
    add(Results(tmp_path), "random")
    motor, positions, problems = behavior(Results(tmp_path))
    assert problems == []
    # In half of the states the motor turns at 90 rad/s, observed as 0.5; bins are 0.02 wide.
    highest = motor.loc[motor["density"].idxmax()]
    assert highest["density"] == pytest.approx(0.5 / 0.02)
    assert abs(highest["velocity"] - 0.5) <= 0.011
    assert set(motor["label"]) == {"random (median return 100, 2 episodes)"}
    assert sorted(positions["share"]) == pytest.approx([0.25, 0.25, 0.5])
    # Two of four states are at the origin, a corner of the squares in the middle.
    (middle,) = positions[positions["share"] == 0.5].to_dict("records")
    assert abs(middle["x"]) < middle["reach"] / 40
    assert middle["reach"] > 0.42  # the farthest state


def test_worst_and_three_best_policies_are_shown(tmp_path):
    for median, name in enumerate("abcdef"):
        add(Results(tmp_path), name, float(median))
    motor, positions, _ = behavior(Results(tmp_path))
    assert motor["policy"].unique().tolist() == ["a", "d", "e", "f"]
    assert positions["policy"].unique().tolist() == ["a", "d", "e", "f"]


def test_only_evaluations_with_saved_states_are_drawn(tmp_path):
    add(Results(tmp_path), "without", states=None)
    add(Results(tmp_path), "with", target_yaw=0.5)
    motor, positions, problems = behavior(Results(tmp_path))
    assert problems == []
    assert set(motor["policy"]) == set(positions["policy"]) == {"with"}
    assert set(positions["target_yaw"]) == {0.5}


def test_returns_of_changed_code_are_marked(tmp_path):
    add(Results(tmp_path), "agent", accepted="3f2a91aa")
    motor, *_ = behavior(Results(tmp_path))
    label = "agent (median return 100, 2 episodes, with changed code)"
    assert set(motor["label"]) == {label}


def test_damaged_evaluation_is_reported(tmp_path):
    add(Results(tmp_path), "random")
    (part,) = tmp_path.rglob("policy_states*.parquet")
    part.write_bytes(part.read_bytes()[:-1])
    motor, _, (problem,) = behavior(Results(tmp_path))
    assert motor.empty
    assert part.name in problem


@pytest.mark.parametrize(
    ("speeds", "median", "says"),
    [
        ([], 1.0, "no states, or states that are not finite"),
        ([1.0, np.nan], 1.0, "no states, or states that are not finite"),
        ([1.0], "many", "The evaluation face_direction/random has invalid settings"),
    ],
)
def test_evaluation_without_numbers_is_reported(tmp_path, speeds, median, says):
    places = [0.0] * len(speeds)
    states = {"motor_velocity": speeds, "x": places, "y": places}
    add(Results(tmp_path), "random", median, states)
    motor, _, (problem,) = behavior(Results(tmp_path))
    assert motor.empty
    assert says in problem
