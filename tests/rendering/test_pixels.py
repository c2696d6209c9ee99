"""Tests of pixel observations by the wrappers of dm_control and Gymnasium."""

import gymnasium
import numpy as np
import pytest
import torch
from dm_control import suite
from dm_control.suite.wrappers import pixels
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import AddRenderObservation
from packaging.version import Version

from jbench.registration import environment_id
from jbench.tasks.gym import JitterbugEnv

pytestmark = pytest.mark.usefixtures("coarse_pictures")

SIZE = {"width": 84, "height": 64}
ACTION = np.ones(1, np.float32)


@pytest.fixture
def load():
    """Returns a function that loads a dm_control environment with the pixel wrapper."""
    loaded = []

    def load(camera="overhead", **settings):
        env = suite.load("jitterbug", "move_to_pose", {"random": 3})
        quality = env.physics.model.vis.quality
        quality.shadowsize, quality.offsamples = 64, 0
        loaded.append(env)
        return pixels.Wrapper(env, render_kwargs={**SIZE, "camera_id": camera}, **settings)

    yield load
    for env in loaded:
        env.physics.free()


@pytest.fixture
def make():
    """Returns a function that makes a Gymnasium environment."""
    made = []

    def make(**settings):
        name = environment_id("move_to_pose")
        made.append(gymnasium.make(name, render_mode="rgb_array", **SIZE, **settings))
        return made[-1]

    yield make
    for env in made:
        env.close()


def test_dm_control_observes_pixels(load):
    env = load()
    spec = env.observation_spec()
    assert list(spec) == ["pixels"]
    assert (spec["pixels"].shape, spec["pixels"].dtype) == ((64, 84, 3), np.uint8)
    seen = [env.reset()] + [env.step(ACTION) for _ in range(10)]
    for step in seen:
        spec["pixels"].validate(step.observation["pixels"])
    shown = env.physics.render(**SIZE, camera_id="overhead")
    np.testing.assert_array_equal(seen[-1].observation["pixels"], shown)
    assert np.any(seen[0].observation["pixels"] != shown)  # the robot has moved


def test_gymnasium_observes_pixels(make):
    env = AddRenderObservation(make())
    assert env.observation_space == gymnasium.spaces.Box(0, 255, (64, 84, 3), np.uint8)
    first, _ = env.reset(seed=3)
    for _ in range(10):
        last, *_ = env.step(ACTION)
    np.testing.assert_array_equal(last, env.render())
    assert np.any(first != last)
    np.testing.assert_array_equal(env.reset(seed=3)[0], first)
    # Agents convert them to torch, which refuses negative strides, as Gymnasium's pictures have.
    np.testing.assert_array_equal(torch.from_numpy(last).numpy(), last)


@pytest.mark.skipif(
    Version(gymnasium.__version__) < Version("1.4"),
    reason="this gymnasium can't make the wrapped environment from its spec",
)
def test_gymnasium_checker_accepts_pixels(make, recwarn):
    check_env(AddRenderObservation(make()).unwrapped, skip_render_check=True)
    wrapped = AddRenderObservation(make())
    check_env(wrapped, skip_render_check=True)
    kinds = {str(warning.message) for warning in recwarn}
    assert all("infinity" in kind or "different from the unwrapped" in kind for kind in kinds)


def test_pictures_larger_than_offscreen_buffer_are_complete():
    env = JitterbugEnv("move_to_pose", render_mode="rgb_array", width=2000, height=1100)
    env.reset(seed=0)
    picture = env.render()
    env.close()
    assert picture.shape == (1100, 2000, 3)
    assert picture[0].min() > 50  # sky, not black
    assert picture[:, -1].min() > 20
