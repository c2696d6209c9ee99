"""Tests of augmented robots as environments of dm_control and Gymnasium."""

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import suite
from gymnasium.utils.env_checker import check_env

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.tasks import augmented, model
from jbench.tasks.gym import JitterbugEnv
from jbench.tasks.robots import load_model


def bits(robot):
    """A model serialized to bytes."""
    buffer = np.zeros(mujoco.mj_sizeModel(robot), np.uint8)
    mujoco.mj_saveModel(robot, None, buffer)
    return buffer.tobytes()


def final_positions(env, steps=50):
    """The robot's joint positions after random actions from a seeded start."""
    env.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (steps, 1)):
        env.step(action.astype(np.float32))
    return env.unwrapped.data.qpos.copy()


@pytest.mark.parametrize(
    "make",
    [
        augmented.draw,
        load_model,
        lambda seed: JitterbugEnv("face_direction", augment=seed),
        lambda seed: gymnasium.make("AugmentedJitterbug/MoveToPose-v0", augment=seed),
        lambda seed: suite.load("augmented_jitterbug", "move_to_pose", {"augment": seed}),
    ],
)
def test_negative_seed_is_refused(make):
    with pytest.raises(RequestError) as refusal:
        make(-2)
    assert isinstance(refusal.value, ValueError)
    assert str(refusal.value) == "An augmented robot has no seed -2: use 0 or more."


def test_varied_masses_without_seed_are_refused():
    with pytest.raises(ValueError, match="give its seed"):
        load_model(vary_masses=True)


def test_suite_lists_augmented_and_plain_tasks():
    ours = {("augmented_jitterbug", task) for task in TASKS}
    assert suite.TASKS_BY_DOMAIN["augmented_jitterbug"] == TASKS
    assert ours <= set(suite.ALL_TASKS)
    assert ours <= set(suite.EXTRA)
    assert not ours & set(suite.BENCHMARKING)
    assert suite.TASKS_BY_DOMAIN["jitterbug"] == TASKS


def test_dm_control_model_equals_model_of_seed_bit_for_bit():
    settings = {"augment": 3, "vary_masses": True}
    physics = suite.load("augmented_jitterbug", "move_to_pose", settings).physics
    assert bits(physics.model.ptr) == bits(load_model(3, vary_masses=True))


@pytest.mark.filterwarnings("ignore:.*infinity")  # observations are not clipped
@pytest.mark.parametrize("task", TASKS)
def test_gymnasium_environment_passes_checker(task):
    env = gymnasium.make(environment_id(task, augmented=True), augment=2)
    assert env.spec.id == environment_id(task).replace("Jitterbug", "AugmentedJitterbug")
    assert env.unwrapped.task == task
    assert env.spec.max_episode_steps == 1000
    check_env(env.unwrapped, skip_render_check=True)


def test_gymnasium_environment_has_robot_of_its_seed():
    name = environment_id("face_direction", augmented=True)
    default, third = final_positions(gymnasium.make(name)), gymnasium.make(name, augment=3)
    np.testing.assert_array_equal(
        default, final_positions(JitterbugEnv("face_direction", augment=0))
    )
    np.testing.assert_array_equal(
        final_positions(third), final_positions(JitterbugEnv("face_direction", augment=3))
    )


@pytest.mark.parametrize("seed", range(3))
def test_both_libraries_observe_center_of_mass_of_augmented_robot(robot, seed):
    settings = {"augment": seed, "vary_masses": True}
    theirs = suite.load(
        "augmented_jitterbug",
        "move_in_direction",
        {"random": np.random.RandomState(seed), **settings},
    )
    ours = JitterbugEnv("move_in_direction", **settings)
    ours.np_random = np.random.RandomState(seed)
    # Other densities move the torso's center of mass.
    assert np.abs(ours._torso_offset - model.torso_offset(robot)).max() > 1e-5
    # MuJoCo's own sensor measures the velocity on dm_control's side.
    seen = [(np.concatenate(list(theirs.reset().observation.values())), ours.reset()[0])]
    for action in np.random.default_rng(seed).uniform(-1, 1, (100, 1)).astype(np.float32):
        expected = np.concatenate(list(theirs.step(action).observation.values()))
        seen.append((expected, ours.step(action)[0]))
    expected, found = map(np.array, zip(*seen, strict=True))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
