"""Tests of the vector environment against Gymnasium's `SyncVectorEnv`, bit for bit."""

import copy
import multiprocessing
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.registration import environment_id, register_task
from jbench.tasks.vector import RobotVectorEnv
from jbench.tasks.worlds import EpisodeError

COUNT, LENGTH = 3, 4


def pair(task, augmented=False, mode="NextStep", **settings):
    """The vector environment, and its oracle."""
    register_task(task)
    name = environment_id(task, augmented)
    settings = {"num_envs": COUNT, "max_episode_steps": LENGTH, **settings}
    ours = gymnasium.make_vec(name, autoreset_mode=mode, threads=2, **settings)
    oracle = gymnasium.make_vec(
        name, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **settings
    )
    return ours, oracle


def assert_same(ours, theirs):
    """Two results are equal in type, shape and every bit."""
    assert type(ours) is type(theirs)
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key, value in theirs.items():
            assert_same(ours[key], value)
    elif isinstance(theirs, tuple) or (isinstance(theirs, np.ndarray) and theirs.dtype == object):
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other)
    elif theirs is not None:
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


def steps(count, size=1):
    return np.random.default_rng(0).uniform(-1.2, 1.2, (count, COUNT, size)).astype(np.float32)


AUGMENTED = {"augmented": True, "augment": 3, "vary_masses": True}


@pytest.mark.parametrize(("task", "more"), [*((task, {}) for task in TASKS), (TASKS[1], AUGMENTED)])
def test_every_task_equals_sync_vector_env(task, more):
    ours, oracle = pair(task, **more)
    assert_same(ours.reset(seed=7), oracle.reset(seed=7))
    for actions in steps(2 * LENGTH + 3):
        assert_same(ours.step(actions), oracle.step(actions))
    # Without a seed, the generators continue.
    assert_same(ours.reset(), oracle.reset())


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_every_autoreset_mode_equals_sync_vector_env(mode):
    ours, oracle = pair("move_to_pose", mode=mode)
    assert ours.metadata["autoreset_mode"] is oracle.metadata["autoreset_mode"]
    assert_same(ours.reset(seed=[5, 1, 9]), oracle.reset(seed=[5, 1, 9]))
    mask = np.array([True, False, True])
    for number, actions in enumerate(steps(3 * LENGTH)):
        if number == 2:  # from here on the episodes end at different steps
            options = {"target": [0.1, 0.2, 0.3]}
            seed = [3, None, None]
            results = [
                e.reset(seed=seed, options={**options, "reset_mask": mask}) for e in (ours, oracle)
            ]
            assert_same(*results)
        ours_step, oracle_step = ours.step(actions), oracle.step(actions)
        assert_same(ours_step, oracle_step)
        if mode == "Disabled" and ours_step[3].any():
            ended = ours_step[3]
            results = [e.reset(options={"reset_mask": ended}) for e in (ours, oracle)]
            assert_same(*results)


LEAVES = "tests.gym_tasks:leaves"
"""Its robots fall off the rail at different control steps, or are truncated after 20."""


@pytest.mark.parametrize(
    ("task", "mode", "limit"),
    [
        ("dmc:cheetah-run", "NextStep", LENGTH),
        (LEAVES, "NextStep", 1000),
        (LEAVES, "SameStep", 12),
        (LEAVES, "Disabled", 1000),
    ],
)
def test_other_robots_equal_sync_vector_env(task, mode, limit):
    ours, oracle = pair(task, mode=mode, max_episode_steps=limit)
    assert type(ours) is RobotVectorEnv
    assert ours.metadata.get("render_fps") == oracle.metadata.get("render_fps")
    assert_same(ours.reset(seed=[5, 1, 9]), oracle.reset(seed=[5, 1, 9]))
    mask = np.array([True, False, True])
    terminated = 0
    for number, actions in enumerate(steps(45, *ours.single_action_space.shape)):
        if number == 2:
            options = {"reset_mask": mask}
            results = [env.reset(seed=[3, None, 4], options=options) for env in (ours, oracle)]
            assert_same(*results)
        step = ours.step(actions)
        assert_same(step, oracle.step(actions))
        terminated += step[2].sum()
        ended = step[2] | step[3]
        if mode == "Disabled" and ended.any():
            results = [env.reset(options={"reset_mask": ended}) for env in (ours, oracle)]
            assert_same(*results)
    assert (terminated > 3) == (task == LEAVES)
    ours.close()
    oracle.close()


def test_error_of_an_episode_is_raised():
    ours = RobotVectorEnv("tests.gym_tasks:huge_reward", 2)
    ours.reset(seed=0)
    for _ in range(2):
        ours.step(np.zeros((2, 1)))
    with pytest.raises(EpisodeError, match=r"at control step 3 .* its reward is inf"):
        ours.step(np.zeros((2, 1)))


def test_copy_of_other_robots_begins_with_a_reset():
    ours = RobotVectorEnv("dmc:pendulum-swingup", 2)
    ours.reset(seed=3)
    copied = copy.deepcopy(ours)
    with pytest.raises(ResetNeeded, match="before step"):
        copied.step(np.zeros((2, 1)))
    assert_same(copied.reset(), ours.reset())


def test_spaces_seeds_and_metadata_equal_sync_vector_env():
    ours, oracle = pair("move_to_position")
    assert type(ours) is RobotVectorEnv
    for name in ("observation", "action", "single_observation", "single_action"):
        assert getattr(ours, f"{name}_space") == getattr(oracle, f"{name}_space")
    ours.reset(seed=11)
    oracle.reset(seed=11)
    assert ours.np_random_seed == oracle.np_random_seed == (11, 12, 13)
    assert ours.spec.id == oracle.spec.id
    assert ours.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert ours.metadata["render_fps"] == oracle.metadata["render_fps"]


def test_reset_accepts_target_for_each_environment():
    ours, _ = pair("move_to_position", mode="SameStep")
    targets = np.array([[0.1, 0], [0, 0.2], [0.3, 0.4]])
    _, infos = ours.reset(seed=0, options={"target": targets})
    np.testing.assert_array_equal(infos["target"], targets)
    np.testing.assert_allclose(infos["distance"], [0.1, 0.2, 0.5], rtol=1e-12)
    for actions in steps(LENGTH):
        *_, infos = ours.step(actions)
    np.testing.assert_array_equal(infos["final_info"]["target"], targets)
    assert np.any(infos["target"] != targets)  # those of the next episodes are random


def test_returned_arrays_are_copies():
    ours, oracle = pair("move_to_pose")
    results = ours.reset(seed=2)
    oracle.reset(seed=2)
    for actions in steps(LENGTH + 2):
        observations, infos = results[0], results[-1]
        observations[:] = 9
        for array in infos.values():
            array[:] = 9
        results = ours.step(actions)
        assert_same(results, oracle.step(actions))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"num_envs": 0}, "of at least 1, not 0, 1000 and"),
        ({"max_episode_steps": 0}, "of at least 1, not 1, 0 and"),
        ({"num_envs": 2.5, "max_episode_steps": None}, "must be whole numbers .* 2.5, 1000 and"),
        ({"threads": 0}, "of at least 1, not 1, 1000 and 0"),
        ({"threads": 1.5}, "of at least 1, not 1, 1000 and 1.5"),
        ({"render_mode": "human"}, "'human' is not one of rgb_array"),
        ({"autoreset_mode": "Never"}, "'Never' is not a valid AutoresetMode"),
        ({"task": "fly"}, "Unknown task 'fly'; choose move_from_origin"),
    ],
)
def test_wrong_settings_are_refused(settings, says):
    with pytest.raises(ValueError, match=says):
        RobotVectorEnv(**{"task": "face_direction", **settings})


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"seed": [1, 2]}, r"a list of 3, not \[1, 2\]"),
        ({"seed": 1.5}, "a whole number or a list of 3, not 1.5"),
        ({"options": {"goal": 1}}, "no option goal"),
        ({"options": {"target": [[1], [2]]}}, r"of shape \(1,\) or \(3, 1\)"),
        ({"options": {"reset_mask": [True, False]}}, "an array of 3 booleans"),
        ({"options": {"reset_mask": np.zeros(3, bool)}}, "at least one of them True"),
        ({"options": {"reset_mask": np.ones(3)}}, "booleans"),
    ],
)
def test_wrong_arguments_of_reset_are_refused(arguments, says):
    ours, _ = pair("face_direction")
    with pytest.raises(ValueError, match=says):
        ours.reset(**arguments)


def test_invalid_calls_of_step_and_reset_are_refused():
    ours, _ = pair("face_direction", mode="Disabled")
    actions = steps(LENGTH)
    with pytest.raises(ResetNeeded, match="before step"):
        ours.step(actions[0])
    with pytest.raises(ResetNeeded, match="without reset_mask first"):
        ours.reset(options={"reset_mask": np.ones(COUNT, bool)})
    ours.reset(seed=0)
    with pytest.raises(ValueError, match=r"of shape \(3, 1\), not array"):
        ours.step(actions[0, :, 0])
    for wrong in ([["a"]] * 3, [[0.1], [0.2, 0.3], [0.1]], [[0.1], [np.nan], [0.1]]):
        with pytest.raises(RequestError, match=r"be finite numbers of shape \(3, 1\), not \[\["):
            ours.step(wrong)
    for each in actions:
        ours.step(each)
    with pytest.raises(ResetNeeded, match="Episodes have ended"):
        ours.step(actions[0])
    ours.close()
    ours.close()
    with pytest.raises(ClosedEnvironmentError):
        ours.step(actions[0])


def test_copy_continues_alone():
    ours, oracle = pair("move_to_pose")
    for env in (ours, oracle):
        env.reset(seed=5)
    duplicate = copy.deepcopy(ours)
    for actions in steps(LENGTH + 2):
        assert_same(duplicate.step(actions), oracle.step(actions))
    duplicate.close()
    oracle.reset(seed=5)
    actions = steps(1)[0]
    assert_same(ours.step(actions), oracle.step(actions))


@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_forked_process_continues():
    ours, oracle = pair("move_to_pose")
    first, second = steps(2)
    for env in (ours, oracle):
        env.reset(seed=5)
        env.step(first)  # starts the threads
    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()
    child = context.Process(target=lambda: answers.put(ours.step(second)[0]))
    child.start()
    child.join(60)
    child.kill()
    assert child.exitcode == 0
    np.testing.assert_array_equal(answers.get(), oracle.step(second)[0])


def test_negative_step_limit_disables_truncation():
    ours = RobotVectorEnv("face_direction", max_episode_steps=-1)
    ours.reset(seed=0)
    assert not ours.step(np.ones((1, 1), np.float32))[3].any()


@pytest.mark.usefixtures("rendering")
@pytest.mark.slow
def test_rendered_images_equal_sync_vector_env():
    ours, oracle = pair("move_to_pose", num_envs=2, render_mode="rgb_array", width=64, height=48)
    actions = steps(1)[0, :2]
    for env in (ours, oracle):
        env.reset(seed=3)
        env.step(actions)
    pictures = ours.render()
    np.testing.assert_array_equal(pictures, oracle.render())
    assert np.any(pictures[0] != pictures[1])
    # Rendering does not change the state.
    assert_same(ours.step(actions), oracle.step(actions))
    ours.close()
    oracle.close()
