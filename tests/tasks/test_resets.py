"""Tests of initial states and targets: distributions, hand-computed draws, and generators."""

import math
import random as standard_library

import numpy as np
import pytest
from scipy.stats import kstest

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.tasks.jitterbug import resets

PI = math.pi
DRAWS = 2000

AT_A_PLACE = {"move_to_position", "move_to_pose"}
LOOKING = {"face_direction", "move_in_direction", "move_to_pose"}
GENERATORS = [np.random.RandomState, np.random.default_rng]


class Scripted:
    """A generator that draws the same share of every range, for hand-computed draws."""

    def __init__(self, share):
        self.share = share

    def uniform(self, low, high):
        return low + self.share * (high - low)


def assert_uniform(values, low, high):
    """Asserts that the values are uniform in their range (Kolmogorov-Smirnov)."""
    assert np.min(values) >= low
    assert np.max(values) <= high
    assert kstest(values, "uniform", (low, high - low)).pvalue > 0.001


@pytest.mark.parametrize(
    ("share", "expected"),
    [
        (0, (1, 0, 0, 0)),
        (0.5, (0, 0, 0, 1)),  # half a turn about an axis in the middle of its range
        # A full turn: the other of the two equivalent quaternions.
        (1, (-1, 0, 0, 0)),
        # A quarter turn about (-0.0125, -0.0125, 1), of length sqrt(1.0003125).
        (0.25, (0.5**0.5, -0.0088374546, -0.0088374546, 0.7069963708)),
    ],
)
def test_pose_by_hand(share, expected):
    np.testing.assert_allclose(resets.draw_quaternion(Scripted(share)), expected, atol=1e-10)


@pytest.mark.parametrize(
    ("share", "position", "yaw"),
    [
        (0, (0.05, 0, 0.035), 0),
        (0.25, (0, 0.0875, 0.035), PI / 2),
        (0.5, (-0.125, 0, 0.035), PI),
        (0.75, (0, -0.1625, 0.035), 1.5 * PI),
    ],
)
def test_target_by_hand(share, position, yaw):
    target = resets.draw_target("move_to_pose", Scripted(share))
    np.testing.assert_allclose(target.position, position, atol=1e-15)
    assert target.yaw == yaw


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("task", TASKS)
def test_target_is_uniform_in_ranges_of_task(task, generator):
    random = generator(0)
    targets = [resets.draw_target(task, random) for _ in range(DRAWS)]
    x, y, z = np.transpose([target.position for target in targets])
    yaws = [target.yaw for target in targets]
    assert set(z) == {0.035}
    if task in AT_A_PLACE:
        assert_uniform(np.hypot(x, y), 0.05, 0.2)
        assert_uniform(np.arctan2(y, x), -PI, PI)
    else:
        assert not np.any([x, y])
    if task in LOOKING:
        assert_uniform(yaws, 0, 2 * PI)
    else:
        assert set(yaws) == {0}


@pytest.mark.parametrize("generator", GENERATORS)
def test_pose_is_uniform_turn_about_nearly_vertical_axis(generator):
    random = generator(1)
    quaternions = [resets.draw_quaternion(random) for _ in range(DRAWS)]
    w, x, y, z = np.transpose(quaternions)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1, atol=1e-15)
    assert_uniform(2 * np.arctan2(z, w) % (2 * PI), 0, 2 * PI)
    assert_uniform(x / z, -0.025, 0.025)
    assert_uniform(y / z, -0.025, 0.025)


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("task", TASKS)
def test_only_given_generator_is_used(task, generator):
    def draw(random):
        return [*resets.draw_quaternion(random), *np.hstack(resets.draw_target(task, random))]

    before = np.random.get_state()[1:3], standard_library.getstate()
    first = draw(generator(5))
    after = np.random.get_state()[1:3], standard_library.getstate()
    np.testing.assert_equal(after, before)
    np.random.seed(1)
    assert draw(generator(5)) == first
    assert draw(generator(6)) != first


@pytest.mark.parametrize(
    ("task", "numbers", "position", "yaw"),
    [
        ("face_direction", 2, (0, 0, 0.035), 2),
        ("move_in_direction", [-9], (0, 0, 0.035), -9),
        ("move_to_position", (0.1, -0.2), (0.1, -0.2, 0.035), 0),
        ("move_to_pose", np.array([0.1, -0.2, 3]), (0.1, -0.2, 0.035), 3),
    ],
)
def test_chosen_target_by_hand(task, numbers, position, yaw):
    target = resets.option_target(task, {"target": numbers}, 2)
    assert [*map(tuple, target.position)] == [position] * 2
    assert target.yaw.tolist() == [yaw] * 2
    assert resets.target_numbers(task, target).tolist() == [np.atleast_1d(numbers).tolist()] * 2


@pytest.mark.parametrize(
    ("task", "numbers", "says"),
    [
        ("move_from_origin", [0, 0], "has no target to choose"),
        ("face_direction", [1, 2], r"array \(yaw\) of finite numbers, of shape \(1,\) or \(2, 1\)"),
        ("move_to_position", 0.1, r"array \(x, y\) .* of shape \(2,\) or"),
        ("move_to_pose", [0.1, 0.2], r"\(x, y, yaw\) .*not \[0.1, 0.2\]"),
        ("move_to_pose", [0.1, 0.2, math.nan], "finite"),
        ("move_to_pose", [0.1, 0.2, math.inf], "finite"),
        ("move_to_pose", "north", "not 'north'"),
        ("move_to_pose", {"x": 1}, "not {'x': 1}"),
        ("move_to_pose", [[0.1, 0.2, 0]], "shape"),
        ("move_to_pose", None, "not None"),
    ],
)
def test_wrong_target_is_refused(task, numbers, says):
    with pytest.raises(RequestError, match=says):
        resets.option_target(task, {"target": numbers}, 2)
