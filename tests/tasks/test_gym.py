"""Tests of the five tasks in Gymnasium: API, rendering, and equality with dm_control."""

import copy
import math
import subprocess
import sys

import gymnasium
import mujoco
import numpy as np
import pytest
import torch
from dm_control import suite
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import AddRenderObservation

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.tasks.gym import RobotEnv
from tests.tasks.robot_states import SIZES

# Programs of users have these ids.
IDS = {
    "move_from_origin": "Jitterbug/MoveFromOrigin-v0",
    "face_direction": "Jitterbug/FaceDirection-v0",
    "move_in_direction": "Jitterbug/MoveInDirection-v0",
    "move_to_position": "Jitterbug/MoveToPosition-v0",
    "move_to_pose": "Jitterbug/MoveToPose-v0",
}
EVERY_TASK = pytest.mark.parametrize("task", TASKS)

PLAIN_IDS = """
import sys, gymnasium, jbench
assert "dm_control" not in sys.modules
assert gymnasium.spec("AugmentedJitterbug/MoveToPose-v0").kwargs["augment"] == 0
env = gymnasium.make("Jitterbug/FaceDirection-v0")
print(env.unwrapped.task, env.spec.reward_threshold)
env = gymnasium.make("jbench:Jitterbug/MoveToPose-v0")
print(env.unwrapped.task)
"""


def roll_out(env, steps=20, actions=None, seed=0):
    """Observations, rewards and end flags of `steps` steps, by default with random actions."""
    if actions is None:
        actions = np.random.default_rng(1).uniform(-1, 1, (steps, 1))
    seen = [env.reset(seed=seed)[0]]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(np.float32(action))
        seen.append((*observation, reward, terminated, truncated))
    return [tuple(row) for row in seen]


def picture_env(camera="tracking", width=96):
    return RobotEnv("move_to_pose", "rgb_array", camera, width, height=64)


@pytest.mark.parametrize(
    ("entry_point", "task"),
    [
        ("jbench.tasks.gym:JitterbugEnv", "face_direction"),
        ("jbench.tasks.dm_gym:SuiteEnv", "dmc:cartpole-swingup"),
    ],
)
def test_environment_of_an_older_minari_dataset_is_made(entry_point, task):
    spec = gymnasium.spec(environment_id(task))
    older = copy.deepcopy(spec)
    older.entry_point = entry_point
    ours, theirs = gymnasium.make(spec), gymnasium.make(older)
    np.testing.assert_array_equal(ours.reset(seed=0)[0], theirs.reset(seed=0)[0])


@EVERY_TASK
def test_environment_passes_gymnasium_checker(task, recwarn):
    check_env(RobotEnv(task), skip_render_check=True)  # rendered by the tests below
    warnings = [str(warning.message) for warning in recwarn]
    assert all("infinity" in warning for warning in warnings)  # observations are not clipped


@pytest.mark.parametrize("task", IDS)
def test_registered_environment_has_the_spaces_of_its_task(task):
    env = gymnasium.make(IDS[task])
    assert environment_id(task) == IDS[task]
    assert (env.unwrapped.task, env.spec.max_episode_steps) == (task, 1000)
    assert env.observation_space == gymnasium.spaces.Box(
        -np.inf, np.inf, (SIZES[task],), np.float32
    )
    assert env.action_space == gymnasium.spaces.Box(-1, 1, (1,), np.float32)
    assert env.metadata["render_fps"] == 100  # one picture per control step of 0.01 s


def test_import_registers_ids_and_imports_no_environment():
    done = subprocess.run([sys.executable, "-c", PLAIN_IDS], capture_output=True, text=True)
    assert done.stdout == "face_direction 900\nmove_to_pose\n", done.stderr


def test_episode_is_truncated_after_1000_steps_and_never_terminated():
    env = gymnasium.make(IDS["move_to_pose"])
    ends = [row[-2:] for row in roll_out(env, 1000)[1:]]
    assert ends == [(False, False)] * 999 + [(False, True)]


@EVERY_TASK
def test_seed_determines_episode(task):
    env, other = RobotEnv(task), RobotEnv(task)
    first = roll_out(env, seed=5)
    roll_out(other, seed=6)  # earlier episodes do not matter
    assert roll_out(other, seed=5) == first
    assert roll_out(other, seed=6) != first


@pytest.mark.parametrize(("beyond", "limit"), [(5, 1), (-1.5, -1)])
def test_actions_are_clipped_to_one(beyond, limit):
    env = RobotEnv("face_direction")
    assert roll_out(env, actions=[[beyond]] * 20) == roll_out(env, actions=[[limit]] * 20)
    assert roll_out(env, actions=[[limit]] * 20) != roll_out(env, actions=[[limit / 2]] * 20)


@pytest.mark.parametrize(
    ("domain", "task", "seed"),
    [
        *(("jitterbug", task, 0) for task in TASKS),
        # Other densities move the torso's center of mass, whose velocity this task observes.
        ("augmented_jitterbug", "move_in_direction", 0),
        *(
            pytest.param("augmented_jitterbug", "move_in_direction", seed, marks=pytest.mark.slow)
            for seed in (1, 2)
        ),
    ],
)
def test_gymnasium_and_dm_control_give_same_episode(domain, task, seed):
    robot = {"augment": seed, "vary_masses": True} if domain == "augmented_jitterbug" else {}
    # Both draw the pose, then the target: equal generators give equal starts.
    theirs = suite.load(domain, task, {"random": np.random.RandomState(seed), **robot})
    ours = RobotEnv(task, **robot)
    ours.np_random = np.random.RandomState(seed)
    seen = [(np.concatenate(list(theirs.reset().observation.values())), ours.reset()[0])]
    rewards = []
    for action in np.random.default_rng(seed).uniform(-1, 1, (50, 1)).astype(np.float32):
        step = theirs.step(action)
        observation, reward, *_ = ours.step(action)
        seen.append((np.concatenate(list(step.observation.values())), observation))
        rewards.append((step.reward, reward))
    for pairs in (seen, rewards):
        expected, found = map(np.array, zip(*pairs, strict=True))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@EVERY_TASK
def test_returned_arrays_are_copies(task):
    env = RobotEnv(task)
    expected = roll_out(env)
    kept = env.reset(seed=0)[0]
    env.step(np.ones(1, np.float32))[0][:] = 9
    assert tuple(kept) == expected[0]
    assert roll_out(env) == expected


def test_state_that_is_set_is_stepped():
    env = RobotEnv("move_to_pose")
    env.reset(seed=0)
    env.data.qpos[:2] = 0.05, -0.02
    env.model.opt.gravity[2] *= 2
    data = copy.copy(env.data)
    data.ctrl[0] = 0.5
    mujoco.mj_step(copy.deepcopy(env.model), data, nstep=50)
    observation, *_ = env.step(np.array([0.5]))
    np.testing.assert_array_equal(env.data.qpos, data.qpos)
    np.testing.assert_allclose(2 * observation[:2], data.qpos[:2], rtol=1e-6)


@pytest.mark.parametrize("task", ["move_to_pose", "dmc:pendulum-swingup"])
def test_state_that_is_assigned_is_stepped(task):
    env = RobotEnv(task)
    env.reset(seed=0)
    before = copy.copy(env.data)
    first = env.step(np.array([0.5]))[:2]
    assert env.step(np.array([0.5]))[0].tolist() != first[0].tolist()
    env.data = before
    again = env.step(np.array([0.5]))[:2]
    np.testing.assert_array_equal(again[0], first[0])
    assert again[1] == first[1]


def test_options_that_a_task_does_not_have_are_refused():
    env = RobotEnv("dmc:pendulum-swingup")
    with pytest.raises(RequestError, match="reset has no option target; leave the options out"):
        env.reset(options={"target": 1.0})


@EVERY_TASK
def test_info_has_target_and_terms_of_reward(task):
    env = RobotEnv(task)
    info = env.reset(seed=3)[1]
    assert all(type(value) is float for key, value in info.items() if key != "target")
    begin = info.pop("target", None)
    for _ in range(3):
        _, reward, *_, after = env.step(np.ones(1, np.float32))
        terms = [value for key, value in after.items() if key.startswith("reward_")]
        assert math.prod(terms) == reward
        np.testing.assert_array_equal(after.pop("target", None), begin)
        assert after.keys() == info.keys()
        assert after != info


@pytest.mark.parametrize(
    ("task", "target", "distance"),
    [
        ("face_direction", -1.0, None),
        ("move_to_pose", (0.12, -0.05, 2.0), 0.13),
        ("move_to_position", [0.03, 0.04], 0.05),
    ],
)
def test_reset_accepts_target(task, target, distance):
    env, plain = RobotEnv(task), RobotEnv(task)
    before = plain.reset(seed=4)[0]
    observation, info = env.reset(seed=4, options={"target": target})
    assert info["target"].tolist() == np.atleast_1d(target).tolist()
    # The pose is that of the seed; only features of the target differ.
    np.testing.assert_array_equal(observation[:15], before[:15])
    assert np.any(observation[15:] != before[15:])
    if distance is not None:
        # The horizontal distance as observed, up to the tilt of the pose: 1 means 3 m.
        assert 3 * np.linalg.norm(observation[15:17]) == pytest.approx(distance, rel=2e-3)
        assert info["distance"] == pytest.approx(distance, rel=1e-9)
    assert env.step(np.ones(1, np.float32))[-1]["target"].tolist() == info["target"].tolist()
    # The next episode is the same as without the option.
    np.testing.assert_array_equal(env.reset()[0], plain.reset()[0])


@pytest.mark.parametrize(
    ("call", "arguments", "says"),
    [
        ("reset", {"options": {"goal": 1}}, "reset has no option goal; it has target"),
        ("reset", {"options": {"target": [1, 2]}}, "The target of face_direction is an array"),
        *(
            ("step", {"action": action}, r"must be finite numbers of shape \(1,\), not")
            for action in ([0.1, 0.2], [], None, "a", {"a": 1}, [np.nan], [np.inf])
        ),
    ],
)
def test_invalid_call_is_refused_and_changes_nothing(call, arguments, says):
    env, plain = RobotEnv("face_direction"), RobotEnv("face_direction")
    for environment in (env, plain):
        environment.reset(seed=1)
    with pytest.raises(RequestError, match=says):
        getattr(env, call)(**arguments)
    np.testing.assert_array_equal(env.step([0.5])[0], plain.step(np.float32([0.5]))[0])


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"task": "fly"}, "Unknown task 'fly'; choose .*move_to_pose"),
        ({"camera": "side"}, "face_direction has no camera side; it has overhead, .* or free"),
        ({"render_mode": "ascii"}, "'ascii' is not one of .*rgb_array"),
        ({"width": 0}, "pixels of at least 1, not 0 and 480"),
        ({"height": "9"}, "pixels of at least 1, not 640 and '9'"),
        ({"augment": 1.5}, "no seed 1.5"),
        ({"augment": "3"}, "no seed '3'"),
    ],
)
def test_wrong_setting_is_refused(settings, says):
    with pytest.raises(ValueError, match=says):
        RobotEnv(**{"task": "face_direction", **settings})


def test_window_without_display_is_refused(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RequestError, match=r"no display .* render_mode='rgb_array'"):
        RobotEnv("face_direction", render_mode="human").reset(seed=0)


@pytest.mark.usefixtures("coarse_pictures")
def test_image_has_expected_shape_and_colors():
    env = gymnasium.make(IDS["move_to_pose"], render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    env.close()
    assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
    # Yellow torso (.93, .74, .20) on blue floor: red exceeds blue in few pixels, blue red in many.
    red, blue = picture[..., 0].astype(int), picture[..., 2].astype(int)
    assert 0.001 < np.mean(red > blue + 50) < 0.5
    assert np.mean(blue > red + 20) > 0.1


@pytest.mark.usefixtures("coarse_pictures")
def test_environments_and_copies_render_independently_and_again_after_close():
    one, other = picture_env(), picture_env("overhead", width=64)
    for env in (one, other):
        env.reset(seed=0)
    pictures = one.render(), other.render()
    duplicate = copy.deepcopy(one)
    np.testing.assert_array_equal(one.render(), pictures[0])
    np.testing.assert_array_equal(other.render(), pictures[1])
    for _ in range(2):
        one.close()
    np.testing.assert_array_equal(one.render(), pictures[0])
    one.step([1.0])
    np.testing.assert_array_equal(duplicate.render(), pictures[0])
    for env in (one, other, duplicate):
        env.close()


@pytest.mark.usefixtures("coarse_pictures")
def test_gymnasium_observes_pixels():
    name = environment_id("move_to_pose")
    env = AddRenderObservation(gymnasium.make(name, render_mode="rgb_array", width=84, height=64))
    assert env.observation_space == gymnasium.spaces.Box(0, 255, (64, 84, 3), np.uint8)
    first, _ = env.reset(seed=3)
    for _ in range(10):
        last, *_ = env.step(np.ones(1, np.float32))
    np.testing.assert_array_equal(last, env.render())
    assert np.any(first != last)
    np.testing.assert_array_equal(env.reset(seed=3)[0], first)
    # Agents convert them to torch, which refuses negative strides, as Gymnasium's pictures have.
    np.testing.assert_array_equal(torch.from_numpy(last).numpy(), last)
    env.close()


@pytest.mark.usefixtures("coarse_pictures")
def test_pictures_larger_than_offscreen_buffer_are_complete():
    env = RobotEnv("move_to_pose", render_mode="rgb_array", width=2000, height=1100)
    env.reset(seed=0)
    picture = env.render()
    env.close()
    assert picture.shape == (1100, 2000, 3)
    assert picture[0].min() > 50  # sky, not black
    assert picture[:, -1].min() > 20
