"""Tests of evaluations during training and of the robot's path in their first episode."""

import mujoco
import numpy as np
import pytest

from jbench.names import EPISODE_STEPS, PHYSICS_STEPS
from jbench.settings.records import ExternalSettings
from jbench.tasks import features, geometry, resets
from jbench.tasks import model as robot
from jbench.tasks.robots import load_model
from jbench.training.evaluation import evaluate_policies


def act(observations):
    """Returns an action for each observation; without sums, a batch rounds as single rows do."""
    return 0.6 + 0.4 * np.cos(9 * observations[:, 7:8])


def stepped_alone(task, starts, episode):
    """Returns x, y and heading at every control step of an episode, computed by plain MuJoCo."""
    model = load_model(None)
    data, offset = mujoco.MjData(model), robot.torso_offset(model)
    robot.place(data, starts[0][episode])
    target = geometry.Target(*(part[episode] for part in starts[1]))
    points, matrix = [], np.zeros(9)
    for _ in range(EPISODE_STEPS + 1):
        mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
        # The robot faces -y of its torso, 90 degrees from the x axis, the matrix's first column.
        points.append([*data.qpos[:2], np.arctan2(matrix[3], matrix[0]) - np.pi / 2])
        state = robot.read_state(data.qpos, data.qvel, offset)
        observation = np.asarray(features.observation(task, state, target), np.float32)
        data.ctrl[0] = np.clip(act(observation[None])[0, 0], -1, 1)
        mujoco.mj_step(model, data, nstep=PHYSICS_STEPS)
    return np.array(points)


@pytest.mark.parametrize(
    "task",
    [
        "move_to_pose",
        pytest.param("face_direction", marks=pytest.mark.slow),
        pytest.param("move_from_origin", marks=pytest.mark.slow),
    ],
)
def test_path_equals_that_of_robot_stepped_alone(task):
    settings = ExternalSettings(
        **{"task": task, "algo": "mine", "seed": 0, "steps": 1000, "hyperparameters": {}},
        **{"evaluate_every": 1000, "evaluate_episodes": 3},
    )
    (made,) = evaluate_policies(settings, [7], 2, act)
    starts = resets.draw_starts(task, [resets.episode_generator(7, 2)] * 3)
    alone = stepped_alone(task, starts, 0)
    assert np.ptp(alone[:, 0]) > 0.01
    assert made.path.points.shape == (51, 3)
    np.testing.assert_array_equal(made.path.points[:, :2], alone[::20, :2].astype(np.float32))
    turn = np.exp(1j * made.path.points[:, 2]) / np.exp(1j * alone[::20, 2])
    np.testing.assert_allclose(turn, 1, atol=1e-5)
    numbers = resets.target_numbers(task, starts[1])[0]
    assert [*made.path.target.values()] == numbers.tolist()
