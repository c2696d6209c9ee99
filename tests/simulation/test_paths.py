"""Tests of path points (position and heading) and targets of paths."""

import numpy as np
import pytest

from jbench.simulation.paths import path_of, path_point
from jbench.tasks.features import State


def state(*positions):
    return State(np.array(positions), *[np.zeros(len(positions))] * 4)


def test_path_point_is_position_and_heading():
    # Unturned, the robot faces -y; turned by 90 degrees, it faces x.
    turned = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    found = path_point(state([0.1, -0.2, 0.03, 1, 0, 0, 0], [0, 0, 0.03, *turned]))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, [[0.1, -0.2, -np.pi / 2], [0, 0, 0]], atol=1e-7)


@pytest.mark.parametrize(
    ("task", "target"),
    [
        ("move_from_origin", {}),
        ("face_direction", {"yaw": 3.0}),
        ("move_to_position", {"x": 0.1, "y": 0.2}),
        ("move_to_pose", {"x": 0.1, "y": 0.2, "yaw": 3.0}),
    ],
)
def test_path_has_random_components_of_target(task, target):
    points = [np.full(3, number, np.float32) for number in (1, 2)]
    path = path_of(task, points, np.array([*target.values()]))
    assert path.target == target
    assert path.points.tolist() == [[1, 1, 1], [2, 2, 2]]
