"""Tests of tasks of other robots against dm_control, and of those that are refused."""

import os
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from dm_control import suite
from gymnasium.envs.registration import registry
from gymnasium.error import ResetNeeded

import jbench.tasks  # noqa: F401 - registers the environments
from jbench.errors import RequestError, WorkError
from jbench.task_specs import SUITE_TASKS
from jbench.tasks.environment_specification import CommandBounds
from jbench.tasks.find import check_specs, checked_task, find_task
from jbench.tasks.gym import RobotEnv
from tests.third_party_task import own_tasks

OWN = "tests.third_party_task.own_tasks"

COMPARED = 300
"""Control steps of an episode that are compared with dm_control."""


def flat(timestep):
    values = timestep.observation.values()
    return np.concatenate([np.ravel(value) for value in values]).astype(np.float32)


@pytest.mark.parametrize(
    "name",
    [
        "cheetah-run",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in (
                *("acrobot-swingup", "cartpole-swingup", "finger-spin", "fish-swim", "hopper-hop"),
                *("manipulator-bring_ball", "quadruped-walk", "reacher-easy", "swimmer-swimmer6"),
            )
        ),
    ],
)
def test_episodes_equal_those_of_dm_control(name):
    task = find_task(f"dmc:{name}")
    domain, _, level = name.partition("-")
    generators = [np.random.default_rng(seed) for seed in (3, 4)]
    seeds = [int(np.random.default_rng(seed).integers(2**32)) for seed in (3, 4)]
    environments = [suite.load(domain, level, task_kwargs={"random": seed}) for seed in seeds]
    spec, random = environments[0].action_spec(), np.random.default_rng(0)
    with task.worlds(2) as worlds:
        worlds.reset([np.random.default_rng(9)] * 2)
        worlds.step(np.zeros((2, task.action_size)))  # another episode before does not matter
        seen = worlds.reset(generators)
        np.testing.assert_array_equal(seen, [flat(one.reset()) for one in environments])
        for _ in range(COMPARED):
            actions = random.uniform(-1.2, 1.2, (2, task.action_size))
            observations, rewards = worlds.step(actions)
            share = (np.clip(actions, -1, 1) + 1) * ((spec.maximum - spec.minimum) / 2)
            theirs = [
                one.step(spec.minimum + a) for one, a in zip(environments, share, strict=True)
            ]
            np.testing.assert_allclose(rewards, [t.reward for t in theirs], rtol=0, atol=0)
            np.testing.assert_array_equal(observations, [flat(t) for t in theirs])


def test_worlds_resume_between_episodes_only():
    task = find_task("dmc:reacher-easy")  # its target is part of the model
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 1, 2))
    with task.worlds(3) as worlds, task.worlds(3) as others:
        worlds.reset([np.random.default_rng(seed) for seed in range(3)])
        states = [worlds.state(slice(i, i + 1)) for i in range(3)]
        first = [worlds.step(np.repeat(action, 3, axis=0)) for action in actions]
        for i in (2, 0, 1):
            others.restore(slice(i, i + 1), states[i])
        again = [others.step(np.repeat(action, 3, axis=0)) for action in actions]
        for (one, _), (other, _) in zip(first, again, strict=True):
            np.testing.assert_array_equal(one, other)
        with pytest.raises(WorkError, match="between two episodes"):
            worlds.state(slice(0, 1))


def test_names_of_suite_are_those_of_dm_control():
    left_out = ("lqr", "jitterbug", "augmented_jitterbug")
    theirs = {f"dmc:{d}-{task}" for d, task in suite.ALL_TASKS if d not in left_out}
    assert set(SUITE_TASKS) == theirs


def test_actions_of_own_task_are_scaled_and_its_seed_is_used():
    task = checked_task(f"{OWN}:Integrator")
    assert dict(task.parts) == {"place": 4, "height": 1}
    with task.worlds(2) as worlds:
        one, other = worlds.reset([np.random.default_rng(0), np.random.default_rng(1)])
        assert (one != other).all()
        again = worlds.reset([np.random.default_rng(0), np.random.default_rng(0)])
        np.testing.assert_array_equal(again, [one, one])
        observations, rewards = worlds.step(np.array([[-1, 1], [0, 5]]))
    # -1 and 1 are -2 and 3, and 0 is their middle; 5 is clipped.
    place = 0.9 * one[:4].reshape(2, 2) + 0.1 * np.array([-2, 3])
    np.testing.assert_allclose(observations[0, :4], place.ravel(), rtol=1e-6)
    np.testing.assert_allclose(rewards[0], np.exp(-np.square(place).sum()), rtol=1e-6)
    place = 0.9 * one[:4].reshape(2, 2) + 0.1 * np.array([0.5, 3])
    np.testing.assert_allclose(observations[1, :4], place.ravel(), rtol=1e-6)


def test_commands_are_never_beyond_the_bounds():
    """In float64, -0.1 + 2 * ((0.3 - -0.1) / 2) is 0.30000000000000004."""
    bounds = CommandBounds(np.array([-0.1]), np.array([0.3]))
    commands = bounds.commands(np.array([[-2.0], [-1.0], [0.0], [1.0], [2.0]]))
    assert commands[[0, 1, 3, 4], 0].tolist() == [-0.1, -0.1, 0.3, 0.3]
    assert commands[2, 0] == pytest.approx(0.1, abs=1e-15)


def test_parts_of_an_observation_have_the_order_of_the_specification():
    observed = []
    for name in ("Integrator", "Reordered"):
        with find_task(f"{OWN}:{name}").worlds(1) as worlds:
            observed += [worlds.reset([np.random.default_rng(0)])]
    np.testing.assert_array_equal(*observed)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            f"{OWN}:EndsEarly",
            "its episode terminates at control step 5, and its time limit is not known: give it "
            "the attribute episode_steps, the control steps of its time limit.$",
        ),
        (f"{OWN}:WrongReward", "its reward is 1.*, not in"),
        (
            f"{OWN}:NotFinite",
            "at control step 3 of the episode .*, height of its observation is not finite",
        ),
        (
            f"{OWN}:ChangesSize",
            "at control step 4 of .*, its observation height has 2 values instead of 1",
        ),
        (f"{OWN}:Unnamed", "its observation has no names"),
        (f"{OWN}:Integers", "its actions are int32 of shape"),
        (f"{OWN}:Unbounded", r"its action 0 is in \[-inf, inf\]; give it two different finite bo"),
        (f"{OWN}:OneValue", r"its action 1 is in \[0.5, 0.5\]; give it two different finite boun"),
        (f"{OWN}:LacksPart", "at control step 0 of .*, its observation lacks height"),
        (f"{OWN}:SameNames", "a dataset of it would have two columns place_0; rename that part"),
        (f"{OWN}:Rewarding", "a dataset of it would have two columns reward; rename that part"),
        (f"{OWN}:Broken", r"it fails \(OSError: no motor, line \d+ of own_tasks\.py\)"),
        (f"{OWN}:unseeded", "its episodes can't be seeded: .* or let its function take a seed as"),
        (f"{OWN}:composed", "let its function take .*, and pass this to composer.Environment as"),
        (f"{OWN}:nothing", "it is a NoneType, not a dm_env.Environment"),
        (f"{OWN}:number", "is of type int; name a function"),
        ("dmc:lqr-lqr_2_1", r"its action 0 is in .*1e[+]10\]; give it two different finite bounds"),
        ("dmc:cheetah-ran", "did you mean dmc:cheetah-run?"),
        ("walker-walk", "did you mean dmc:walker-walk?"),
        ("dmc:jitterbug-face_direction", "did you mean face_direction?"),
    ],
)
def test_task_that_is_refused(name, sentence):
    with pytest.raises(RequestError, match=sentence) as raised:
        checked_task(name)
    assert str(raised.value).count(". ") == 0
    assert str(raised.value).endswith(".")


def test_changed_task_is_refused():
    specs = find_task("dmc:cheetah-run").specs
    check_specs("dmc:cheetah-run", specs)
    with pytest.raises(RequestError, match="has changed since it was recorded: its model differ"):
        check_specs("dmc:cheetah-run", specs.model_copy(update={"model": "0" * 64}))


def test_hash_of_model_is_that_of_the_body():
    hashes = {
        name: find_task(f"dmc:{name}").specs.model
        for name in ("walker-walk", "walker-run", "hopper-hop")
    }
    assert hashes["walker-walk"] == hashes["walker-run"] != hashes["hopper-hop"]


def test_gymnasium_environment_is_a_world_of_the_task():
    env = gymnasium.make("jbench/dmc-quadruped-walk-v0")
    seen, _ = env.reset(seed=5)
    with find_task("dmc:quadruped-walk").worlds(1) as worlds:
        generator = np.random.default_rng(np.random.SeedSequence(5))
        np.testing.assert_array_equal(worlds.reset([generator])[0], seen)
        action = np.full(12, 0.3, np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        observations, rewards = worlds.step(action[None])
    np.testing.assert_array_equal(observations[0], observation)
    assert (reward, terminated, truncated) == (rewards[0], False, False)
    assert env.spec.max_episode_steps == 1000
    assert {f"jbench/{task.replace(':', '-')}-v0" for task in SUITE_TASKS} <= set(registry)


def test_environment_without_a_model_is_not_drawn():
    with pytest.raises(RequestError, match="Integrator has no MuJoCo physics"):
        _ = RobotEnv(f"{OWN}:Integrator").model


def test_environment_that_is_refused_is_closed():
    with pytest.raises(RequestError, match="two different finite bounds"):
        find_task(f"{OWN}:CountedUnbounded")
    assert own_tasks.Counted.opened == 0


def test_factory_in_c_is_called_without_arguments():
    with pytest.raises(RequestError, match="it is a dict, not a dm_env"):
        find_task("builtins:dict")


def test_environments_that_are_replaced_are_closed():
    with find_task(f"{OWN}:Counted").worlds(2) as worlds:
        for _ in range(3):
            worlds.reset([np.random.default_rng(seed) for seed in (0, 1)])
    assert own_tasks.Counted.opened == 0


PICTURES = """
import gymnasium, jbench
names = "jbench/dmc-cheetah-run-v0", "Jitterbug/FaceDirection-v0", "jbench/dmc-walker-walk-v0"
made = [gymnasium.make(name, render_mode="rgb_array", width=64, height=48) for name in ORDER]
for env in made:
    env.reset(seed=0)
drawn = [[env.render() for env in made] for _ in range(2)]
print([picture.shape for picture in drawn[0]])
print(all(picture.std() > 10 for picture in drawn[0]))
print(all((one == other).all() for one, other in zip(*drawn)))
for env in made:
    env.close()
"""


@pytest.mark.usefixtures("rendering")
@pytest.mark.parametrize("order", ["names", pytest.param("names[::-1]", marks=pytest.mark.slow)])
def test_robots_are_drawn_in_turn_without_display_or_setting(order):
    unset = {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"}
    kept = {name: value for name, value in os.environ.items() if name not in unset}
    command = [sys.executable, "-W", "ignore", "-c", PICTURES.replace("ORDER", order)]
    printed = subprocess.check_output(command, env=kept, text=True).splitlines()
    assert printed == [str([(48, 64, 3)] * 3), "True", "True"]


def test_episode_ends_with_the_task_and_is_begun_by_reset():
    env = gymnasium.make("jbench/dmc-pendulum-swingup-v0", max_episode_steps=2000)
    with pytest.raises(ResetNeeded, match="Call reset before step"):
        env.unwrapped.step(np.zeros(1))
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, np.float32))[2:4] for _ in range(1000)]
    assert ends == [(False, False)] * 999 + [(False, True)]
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1, np.float32))
    env.reset()
    assert env.step(np.zeros(1, np.float32))[3] is False


def test_pickled_environment_continues_the_random_numbers():
    env = gymnasium.make("jbench/dmc-pendulum-swingup-v0")
    env.reset(seed=3)
    copied = pickle.loads(pickle.dumps(env))  # noqa: S301
    with pytest.raises(ResetNeeded):
        copied.unwrapped.step(np.zeros(1))
    np.testing.assert_array_equal(copied.reset()[0], env.reset()[0])
