"""Tests of tasks that Gymnasium environments implement."""

import sys

import gymnasium
import numpy as np
import pytest

from jbench.errors import RequestError, WorkError
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.tasks import environment_specification
from jbench.tasks.find import checked_task, find_task, task_provenance
from jbench.tasks.gym_registry import find_environment
from jbench.tasks.task import DOES_NOT_REPEAT

LAB = "tests.gym_tasks"
MISTAKEN = "tests.mistaken_gym_tasks"
ENDLESS = f"gym:{MISTAKEN}:lab/Endless-v0"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            f"{LAB}:falls_without_limit",
            "its episode terminates at control step 7, and its time limit is not known: wrap it in "
            "gymnasium.wrappers.TimeLimit",
        ),
        (f"{LAB}:huge_reward", "at control step 3 of the episode with seed .*, its reward is inf"),
        (f"{LAB}:discrete", "its actions are Discrete, and jbench trains on motors"),
        (f"{LAB}:unbounded", r"its action 0 is in \[-inf, inf\]; give it two different finite"),
        (f"{LAB}:pixels", r"its observation is a picture of shape \(8, 8, 3\)"),
        (f"{LAB}:scaled_pixels", r"its observation eye is a picture of shape \(3, 16, 20\)"),
        (f"{LAB}:counts", "its observation gear is Discrete, and jbench takes real numbers"),
        (
            f"{MISTAKEN}:GoesOn",
            "at control step 8 of .*, its episode continues, although another one was truncated at "
            "this control step, and its time limit is not known: wrap it in "
            "gymnasium.wrappers.TimeLimit.$",
        ),
        (
            f"{MISTAKEN}:StopsEarly",
            "at control step 8 of .*, its episode is truncated, although another one was truncated "
            "at control step 12, and its time limit is not known: wrap it in",
        ),
        (
            f"{MISTAKEN}:SeldomStopsEarly",
            "at control step 8 of .*, its episode is truncated, altho",
        ),
        (f"{MISTAKEN}:swaps_sizes", "step 3 of .*, its observation a has 1 value instead of 2.$"),
        (
            f"{MISTAKEN}:quits",
            r"at control step 3 of .*, it fails \(SystemExit, line \d+ of mistaken_gym_tasks",
        ),
        (
            f"{MISTAKEN}:quits_at_reset",
            r"at control step 0 of .*, it fails \(SystemExit: no license, line \d+ of",
        ),
        ("gym:Pendulun-v1", r"no environment Pendulun-v1; did you mean gym:Pendulum-v1\?$"),
        ("gym:Pendulum", r"no environment Pendulum; did you mean gym:Pendulum-v1\?$"),
        ("gym:Hopper-v99", r"no environment Hopper-v99; did you mean gym:Hopper-v5\?$"),
        ("gym:Zzz-v0", "no environment Zzz-v0; if a module of yours .* type gym:MODULE:Zzz-v0"),
        ("gym:math:Zzz-v0", "no environment Zzz-v0; the module math has to register it"),
        ("gym:math:Hopper", r"no environment Hopper; did you mean gym:Hopper-v5\?$"),
        (
            "gym:tests.drawn_gym_tasks:lab/Drown",
            r"no environment lab/Drown; did you mean gym:tests.drawn_gym_tasks:lab/Drawn-v0\?$",
        ),
        (
            "gym:tests/drawn_gym_tasks.py:lab/Drawn-v0",
            "path of a file; type gym:tests.drawn_gym_tasks:lab/Drawn-v0.$",
        ),
        ("tests/gym_tasks.py:cart", "path of a file; type tests.gym_tasks:cart.$"),
        ("tests.gym_tasks.cart", "the module tests.gym_tasks, type tests.gym_tasks:cart.$"),
        ("tests.gym_tasks", "module tests.gym_tasks, type tests.gym_tasks:NAME, a function in"),
        ("tests", "Unknown task 'tests'; to use the module tests, type tests:NAME, a function in"),
        ("tests.py", "Unknown task 'tests.py'; to use the module tests, type tests:NAME"),
        ("math.cart", "to use the module math, type math:cart.$"),
        ("leg.xml", "leg.xml is a model, and a task also needs rewards; write a function"),
        ("gym:nowhere:Cart-v0", "gym:nowhere:Cart-v0: there is no module nowhere; install its"),
        (
            f"{MISTAKEN}:older_step",
            "at control step 1 .*, its step does not return the 5 values of a gymnasium.Env: "
            "observation, reward, terminated, truncated, info.$",
        ),
        (
            f"{MISTAKEN}:older_reset",
            "its reset does not return the 2 values of a gymnasium.Env: observation, info.$",
        ),
        (f"{MISTAKEN}:no_reward", "at control step 1 .*, its reward is None, not a number.$"),
        (f"{MISTAKEN}:reward_in_array", r"its reward is array\(\[0.5\]\), not a number.$"),
        (
            f"{MISTAKEN}:large_reward",
            r"at control step 1 .*, its reward is -1e\+30; scale it to at most 1e\+15.$",
        ),
        (
            f"{MISTAKEN}:large_observation",
            "at control step 0 .*, cart of its observation is not finite in float32.$",
        ),
        (f"{MISTAKEN}:name_twice", "two parts of its observation are called cart_goal; rename"),
        (
            f"{MISTAKEN}:nothing_observed",
            "its observation is of type NoneType, not of real numbers.$",
        ),
        (f"{MISTAKEN}:sequence", "its observation is Sequence, .*; give it a Box.$"),
        (f"{MISTAKEN}:forgotten_time", r"control_timestep fails \(RuntimeError: no clock, line"),
        (f"{MISTAKEN}:forgotten_model", r"_model: it fails \(RuntimeError: no model, line \d+ of"),
        (f"{MISTAKEN}:same_again", "returns the same environment again; let it make a new one"),
        (
            f"{MISTAKEN}:unlicensed",
            r"made \(RuntimeError: no license for the simulator, line \d+ of",
        ),
        (
            "gym:Hopper-v5,terminate_when_unhealthy=False",
            "terminate_when_unhealthy=False would be the text 'False'; type "
            "terminate_when_unhealthy=false.$",
        ),
        (
            "gym:Hopper-v5,healthy_z_range=[0.6,2],frame_skip=2",
            "the value of healthy_z_range becomes part of the names of runs, so it can't be a list",
        ),
        (
            "gym:Hopper-v5,render_mode=human",
            "it opens a window; make it without render_mode human.$",
        ),
        ('gym:Pendulum-v1,g="9 8"', "the value of g becomes part of the names of runs, .* write a"),
        ("gym:Pendulum-v1,g=~/a", "the value of g becomes part of the names of runs"),
        ("gym:Pendulum-v1,g", "'g' is no argument of gymnasium.make; type NAME=VALUE"),
        ("gym:Pendulum-v1,g=9.8,g=1", "has the argument g twice; type it once"),
        ("Pendulum-v1", "did you mean gym:Pendulum-v1?"),
    ],
)
def test_environment_that_is_refused(name, sentence):
    with pytest.raises(RequestError, match=sentence):
        checked_task(name)


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        (f"{LAB}:endless", "wrap it in gymnasium.wrappers.TimeLimit"),
        (ENDLESS, f"type {ENDLESS},max_episode_steps=N with its control steps for N"),
    ],
)
def test_environment_without_a_limit_is_refused_with_what_to_add(name, advice, monkeypatch):
    monkeypatch.setattr(environment_specification, "_MOST_MEASURED", 1000)
    with pytest.raises(RequestError) as raised:
        find_task(name)
    assert str(raised.value) == (
        f"jbench can't use the task {name}: an episode has more than 1,000 control steps, and its "
        f"time limit is not known: {advice}."
    )


def test_environment_that_truncates_itself_has_the_limit_that_was_measured():
    task = checked_task(f"{MISTAKEN}:TruncatesItself")
    assert (task.episode_steps, task.notes) == (8, ())
    assert checked_task(f"{ENDLESS},max_episode_steps=30").episode_steps == 30


def test_environment_with_a_limit_truncates_itself_before():
    task = checked_task(f"{MISTAKEN}:leaves_area")
    assert task.episode_steps == 20
    with task.worlds(1) as worlds:
        generator = np.random.default_rng(0)
        seed = int(np.random.default_rng(0).integers(2**32))
        position, velocity = np.random.Generator(np.random.PCG64(seed)).uniform(-1, 1, 2)
        worlds.reset([generator])
        steps = 0
        while abs(position) <= 1:
            velocity += 0.1 * 4
            position += 0.1 * velocity
            steps += 1
            worlds.step(np.ones((1, 1)))
        assert worlds.failures == {}
        assert (worlds.terminated[0], worlds.truncated[0]) == (False, True)
        assert worlds.lengths()[0] == steps < 20


def test_parts_of_an_observation_are_named_and_actions_scaled():
    task = checked_task(f"{LAB}:cart")
    assert dict(task.parts) == {"cart": 2, "goal_0": 1, "goal_1": 1}
    assert task.labels == ["cart_0", "cart_1", "goal_0", "goal_1"]
    assert (task.episode_steps, task.action_size) == (20, 1)
    with task.worlds(2) as worlds:
        generators = [np.random.default_rng(seed) for seed in (0, 1)]
        seeds = [int(np.random.default_rng(seed).integers(2**32)) for seed in (0, 1)]
        begun = worlds.reset(generators)
        observations, rewards = worlds.step(np.array([[0.0], [1.0]]))
    for i, (seed, action) in enumerate(zip(seeds, (1.0, 4.0), strict=True)):  # of [-2, 4]
        position, velocity = np.random.Generator(np.random.PCG64(seed)).uniform(-1, 1, 2)
        np.testing.assert_allclose(begun[i], [position, velocity, 0.25, -0.5], rtol=1e-6)
        velocity += 0.1 * action
        position += 0.1 * velocity
        np.testing.assert_allclose(observations[i], [position, velocity, 0.25, -0.5], rtol=1e-5)
        np.testing.assert_allclose(rewards[i], -10 * abs(position), rtol=1e-5)


@pytest.mark.parametrize("name", [f"{MISTAKEN}:list_for_tuple", f"{LAB}:recorded"])
def test_list_for_a_tuple_and_a_wrapper_around_the_limit_change_nothing(name):
    seen = []
    for each in (f"{LAB}:cart", name):
        task = checked_task(each)
        assert (task.episode_steps, task.repeats(), task.notes) == (20, True, ())
        with task.worlds(1) as worlds:
            worlds.reset([np.random.default_rng(0)])
            seen.append(np.concatenate([worlds.step(np.full((1, 1), 0.3))[0] for _ in range(20)]))
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize(
    ("typed", "value"),
    [
        ("9.8", 9.8),
        (".5", 0.5),
        ("2", 2),
        ("inf", np.inf),
        ("true", True),
        ("null", None),
        ("soft", "soft"),
        ("-1e-3", -0.001),
        ("./a/robot.xml", "./a/robot.xml"),
    ],
)
def test_typed_argument_has_a_value(typed, value):
    found = find_environment(f"gym:Pendulum-v1,g={typed}").arguments["g"]
    assert (type(found), found) == (type(value), value)


def test_environments_with_statistics_of_their_own_are_noted():
    # Only the rewards of this one depend on the episodes before.
    reward = checked_task(f"{MISTAKEN}:normalized_reward")
    observation = checked_task(f"{MISTAKEN}:normalized_observation")
    assert [task.repeats() for task in (reward, observation)] == [False, False]
    assert reward.notes[0].startswith("its wrapper NormalizeReward changes the rewards")
    assert observation.notes[0].endswith("leave it out, and type --set normalize=running")
    assert reward.notes[1] == observation.notes[1] == DOES_NOT_REPEAT


def test_time_limit_within_a_longer_one_is_noted():
    task = checked_task(f"{MISTAKEN}:two_limits")
    assert task.episode_steps == 1500
    assert task.notes == (
        "an inner wrapper TimeLimit ends its episodes at control step 20, before its time limit of "
        "1,500; pass max_episode_steps to gymnasium.make instead of a second TimeLimit",
    )


def test_worlds_are_the_environments_of_gymnasium():
    with find_task("gym:Pendulum-v1,g=9.0").worlds(1) as worlds:
        observations = worlds.reset([np.random.default_rng(5)])
        env = gymnasium.make("Pendulum-v1", g=9.0)
        seed = int(np.random.default_rng(5).integers(2**32))
        np.testing.assert_array_equal(observations[0], env.reset(seed=seed)[0])
        for action in np.linspace(-1, 1, 200, dtype=np.float32):
            observations, rewards = worlds.step(action[None, None])
            seen, reward, terminated, truncated, _ = env.step(2 * action[None])
            np.testing.assert_allclose(observations[0], seen, rtol=1e-6)
            assert rewards[0] == pytest.approx(reward, rel=1e-6)
        assert (terminated, truncated) == (False, True)


def test_what_settings_record_of_an_environment():
    specs = find_task("gym:Pendulum-v1").specs
    assert specs.values == {
        "model": None,
        "parts": ["observation"],
        "sizes": [3],
        "action_minimum": [-2.0],
        "action_maximum": [2.0],
        "control_timestep": 0.05,
        "episode_steps": 200,
        "unit_rewards": False,
    }
    weaker = find_task("gym:Pendulum-v1,g=9.0")
    other = DatasetSettings(**dataset_robot(weaker.name, weaker.specs), steps=400)
    assert other.id.startswith("gym.Pendulum-v1.g.9.0/random/s00-")


PUSH = '''
"""A lab's environments."""
import gymnasium
import numpy as np


class Push(gymnasium.Env):
    """A point that a motor pushes."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1, 1, 1), {}

    def step(self, action):
        return self.np_random.uniform(-1, 1, 1), REWARD, False, False, {}


gymnasium.register("NAME-v0", "MODULE:Push", max_episode_steps=20)
'''


def written(directory, module, reward):
    """Writes a module that registers an environment; returns the name of its task."""
    text = PUSH.replace("REWARD", reward).replace("NAME", module.title())
    (directory / f"{module}.py").write_text(text.replace("MODULE", module))
    return f"gym:{module}:{module.title()}-v0"


def test_code_of_a_registered_environment_of_ones_own_is_recorded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names = [written(tmp_path, *each) for each in (("labone", "0.5"), ("labtwo", "0.25"))]
    first, second = (checked_task(name) for name in names)
    assert first.description == "A point that a motor pushes."
    assert None not in (first.specs.sources, second.specs.sources)
    assert first.specs.sources != second.specs.sources
    made = task_provenance(names[0])
    assert list(made["task_sources"]) == ["labone.py"]
    assert "task_package" not in made
    robot = dataset_robot(first.name, first.specs)
    assert robot["robot"] == names[0]
    assert DatasetSettings(**robot, steps=40).id.startswith("gym.labone.Labone-v0/")


def test_module_that_lacks_a_module_of_its_own_is_there(tmp_path, monkeypatch):
    """The name of the missing one may begin its name, as torchrl does torchrl_envs."""
    (tmp_path / "quietlab_envs.py").write_text("import quietlab\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    lacking = r"quietlab_envs of .* can't be imported \(.*No module named 'quietlab'"
    with pytest.raises(WorkError, match=lacking):
        find_environment("gym:quietlab_envs:Quiet-v0")
    with pytest.raises(RequestError, match=r"there is no module quietlab\.envs; install"):
        find_environment("gym:quietlab.envs:Quiet-v0")


def test_package_of_a_registered_environment_is_recorded():
    name = "gym:Pendulum-v1"
    assert find_task(name).specs.sources is None
    assert task_provenance(name) == {"task_package": f"gymnasium {gymnasium.__version__}"}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import nothing_installed", r"ModuleNotFoundError: .*, line 1 of quietimpl\.py"),
        ("class Other: pass", "AttributeError: .* no attribute 'Quiet'"),
    ],
)
def test_environment_whose_code_can_not_be_imported_is_refused(
    text, sentence, tmp_path, monkeypatch
):
    """Its module registers it by a name, at which nothing is imported yet."""
    registration = "gymnasium.register('QuietImpl-v0', 'quietimpl:Quiet', max_episode_steps=5)"
    (tmp_path / "quietimpl_names.py").write_text(f"import gymnasium\n{registration}\n")
    (tmp_path / "quietimpl.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("quietimpl", "quietimpl_names"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.delitem(gymnasium.registry, "QuietImpl-v0", raising=False)
    with pytest.raises(RequestError, match=rf"it can't be made \({sentence}"):
        find_task("gym:quietimpl_names:QuietImpl-v0")
