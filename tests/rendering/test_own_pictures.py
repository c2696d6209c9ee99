"""Tests of environments without MuJoCo physics, which draw themselves."""

import copy
import sys

import gymnasium
import numpy as np
import pytest
from PIL import Image

from jbench.errors import RequestError
from jbench.rendering.episode import Scene, fitted, render_episode
from jbench.rendering.viewer import view
from jbench.tasks.find import find_task
from jbench.tasks.gym import RobotEnv
from jbench.tasks.vector import RobotVectorEnv
from tests import drawn_gym_tasks
from tests.rendering.render_policies import Constant

LAB = "tests.drawn_gym_tasks"
OWN = "tests.third_party_task.own_tasks"


def drawn_by_gymnasium(env, seed, command, steps):
    """Returns the pictures and returns of an episode of an environment until its end."""
    env.reset(seed=int(gymnasium.utils.seeding.np_random(seed)[0].integers(2**32)))
    pictures, returns = [env.render()], [0.0]
    for _ in range(steps):
        _, reward, terminated, truncated, _ = env.step(np.array([[command]]))
        pictures.append(env.render())
        returns.append(returns[-1] + reward)
        if terminated or truncated:
            break
    return pictures, returns


@pytest.mark.parametrize("name", [f"{LAB}:drawn", f"{LAB}:draws_always", f"gym:{LAB}:lab/Drawn-v0"])
def test_frames_are_those_of_the_environment(name):
    """The command 4 is the action 1 of [-2, 4]; the cart leaves its rail by it."""
    frames = list(render_episode(Constant(1.0), Scene(name, seed=3), range(21)))
    pictures, returns = drawn_by_gymnasium(drawn_gym_tasks.drawn("rgb_array"), 3, 4.0, 20)
    assert 5 < len(pictures) < 20
    assert len({picture.tobytes() for picture in pictures}) > 5
    np.testing.assert_array_equal([frame.picture for frame in frames], pictures)
    np.testing.assert_allclose([frame.episode_return for frame in frames], returns)
    assert [frame.time for frame in frames] == pytest.approx(np.arange(len(pictures)) / 25)


def test_pictures_have_the_size_of_the_first(tmp_path, run_command):
    """A picture of half the width stands in the middle, with black margins."""
    frames = list(render_episode(Constant(0.0), Scene(f"{LAB}:narrows", seed=3), range(4)))
    whole = list(render_episode(Constant(0.0), Scene(f"{LAB}:drawn", seed=3), range(4)))
    expected = [frame.picture.copy() for frame in whole]
    for picture in expected[1:]:
        picture[:, :10] = 0
        picture[:, 30:] = 0
    np.testing.assert_array_equal([frame.picture for frame in frames], expected)
    for name in ("a.gif", "a.png", "a.mp4"):
        where = ("--out", tmp_path / name, "--steps", "4", "--task", f"{LAB}:narrows")
        assert run_command("render", "random", *where, results=tmp_path)[0] == 0
    assert Image.open(tmp_path / "a.gif").size == (40, 24)
    assert Image.open(tmp_path / "a.png").size == (5 * 40, 24)


def test_picture_of_another_size_keeps_its_proportions():
    """Of 6 x 10 white pixels, 24 x 40 have no margin, and 24 x 60 have ten columns on each side."""
    small = np.full((6, 10, 3), 255, np.uint8)
    assert (fitted(small, np.zeros((24, 40, 3), np.uint8)) == 255).all()
    wide = fitted(small, np.zeros((24, 60, 3), np.uint8))
    assert (wide[:, 10:50] == 255).all()
    assert not wide[:, :10].any()
    assert not wide[:, 50:].any()


def test_environments_of_gymnasium_and_copies_have_the_pictures():
    env = RobotEnv(f"{LAB}:drawn", "rgb_array")
    envs = RobotVectorEnv(f"{LAB}:drawn", 2, render_mode="rgb_array")
    copied = copy.deepcopy(env)
    assert env.metadata["render_fps"] == 25
    env.reset(seed=1)
    copied.reset(seed=1)
    envs.reset(seed=0)
    first, second = envs.render()
    np.testing.assert_array_equal(env.render(), second)
    np.testing.assert_array_equal(copied.render(), second)
    assert (first != second).any()
    # A picture belongs to the caller.
    before = env.render()
    env.step(np.ones(1, np.float32))
    env.step(np.ones(1, np.float32))
    np.testing.assert_array_equal(before, second)


def test_what_is_recorded_of_an_environment_does_not_depend_on_its_pictures():
    plain, drawn = find_task(f"{LAB}:takes_no_mode"), find_task(f"{LAB}:drawn")
    assert plain.specs == drawn.specs
    assert drawn.control_timestep is None


def test_command_draws_without_a_backend_of_opengl(tmp_path, run_command, refused, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    where = ("--out", tmp_path / "a.png", "--steps", "4")
    code, *_ = run_command("render", "random", "--task", f"{LAB}:drawn", *where, results=tmp_path)
    assert code == 0
    assert Image.open(tmp_path / "a.png").size == (5 * 40, 24)
    for task in ("face_direction", "gym:Hopper-v5"):
        monkeypatch.setenv("MUJOCO_GL", "vulkan")
        said = refused("render", "random", "--task", task, *where, results=tmp_path)
        assert "MUJOCO_GL=vulkan is not a backend" in said


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("without_mode", "lacks 'rgb_array'; add that, and let its render return a picture."),
        ("takes_no_mode", "its render_mode is None; give its function the argument render_mode,"),
        ("nothing", "its render returns NoneType, not an array (height, width, 3) of uint8."),
        ("numbers", "its render returns an array (4, 4) of float64, not an array"),
        ("no_pixel", "its render returns an array (0, 40, 3) of uint8, not an array"),
        ("error", "its render fails (ValueError: no such color, line "),
        ("lacks_package", "can't be drawn: paint is not installed, run `pip install paint`."),
        ("lacks_simulator", "use the task {name}: paint is not installed, run `pip install paint`"),
    ],
)
def test_environment_that_is_not_drawn_is_refused(name, sentence, tmp_path, refused):
    task = f"{LAB}:{name}"
    arguments = ("--task", task, "--out", tmp_path / "a.gif")
    assert sentence.format(name=task) in refused("render", "random", *arguments, results=tmp_path)
    assert not (tmp_path / "a.gif").exists()


def test_environment_of_dm_env_without_physics_is_refused():
    with pytest.raises(RequestError, match=r"no MuJoCo physics; return a gymnasium\.Env"):
        RobotEnv(f"{OWN}:Integrator", "rgb_array")


def test_package_that_gymnasium_draws_with_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = RobotEnv("gym:Pendulum-v1", "rgb_array")
    env.reset(seed=0)
    with pytest.raises(RequestError, match=r"gym:Pendulum-v1 can't be drawn: pygame is not inst"):
        env.render()


def test_views_of_a_model_are_refused():
    task = f"{LAB}:drawn"
    with pytest.raises(RequestError, match="has no camera side: it draws itself; leave the camera"):
        RobotEnv(task, "rgb_array", camera="side")
    with pytest.raises(RequestError, match="to show in a window; render_mode='rgb_array' returns"):
        RobotEnv(task, "human")
    with pytest.raises(RequestError, match="no MuJoCo physics, which a window shows; type jbench"):
        view(Constant(), Scene(task))
