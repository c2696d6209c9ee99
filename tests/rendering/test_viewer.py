"""Tests of MuJoCo's window, under a virtual display, and of the errors without a display."""

import contextlib
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from jbench.errors import RequestError
from jbench.rendering import viewer
from jbench.rendering.episode import Scene
from jbench.rendering.viewer import view
from jbench.tasks.gym import RobotEnv
from tests.rendering.render_policies import Constant

OWN = "tests.third_party_task.own_tasks"
ODD = "tests.odd_tasks"

# At its 60th action, in the third episode of 25 steps, the policy takes a screenshot and closes the
# window.
WATCH = """
import sys
import time
import mujoco.viewer
import numpy as np
from PIL import ImageGrab
from jbench.rendering import viewer
from jbench.rendering.episode import Scene
from jbench.tasks.find import find_task
from tests.rendering.render_policies import Constant
from tests.short_episodes import shorten_episodes

windows, launch = [], mujoco.viewer.launch_passive
def launch_and_keep(*arguments, **settings):
    windows.append(launch(*arguments, **settings))
    return windows[0]
mujoco.viewer.launch_passive = launch_and_keep
shorten_episodes(steps=25)

class Closing(Constant):
    def act(self, observations):
        if len(self.observations) == 59:
            # A separate thread draws the window, which may be late on a busy machine.
            deadline = time.monotonic() + 120
            while time.monotonic() < deadline:
                picture = ImageGrab.grab()
                red, green, blue = np.asarray(picture.convert("RGB")).astype(int).T
                if np.sum((red > 150) & (green > 110) & (blue < 80)) > 200:
                    break
                time.sleep(0.2)
            picture.save(sys.argv[1])
            windows[0].close()
        return super().act(observations)

task = sys.argv[2]
policy = Closing(np.full(find_task(task).action_size, 0.5))
print(viewer.view(policy, Scene(task, seed=1)), len(policy.robots))
"""


@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="no virtual display: install xvfb")
@pytest.mark.parametrize("task", ["face_direction", "dmc:cheetah-run"])
def test_window_shows_robot_until_closed(task, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.setenv("MUJOCO_GL", "disable")  # as in the command line
    screen = ["xvfb-run", "--auto-servernum", "--server-args", "-screen 0 1280x1024x24"]
    done = subprocess.run(
        [*screen, sys.executable, "-c", WATCH, tmp_path / "screen.png", task],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr  # and did not crash while closing
    assert done.stdout.split() == ["60", "3"]
    red, green, blue = np.asarray(Image.open(tmp_path / "screen.png").convert("RGB")).astype(int).T
    assert np.sum((red > 150) & (green > 110) & (blue < 80)) > 200  # the yellow robot
    assert np.mean((blue > red + 30) & (blue > green + 15)) > 0.2  # the blue floor


def test_display_that_cannot_be_opened_is_refused(monkeypatch):
    import glfw

    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr(glfw, "init", lambda: False)
    closed = []
    monkeypatch.setattr(RobotEnv, "close", lambda env: closed.append(env))
    with pytest.raises(RequestError, match="The display can't be opened; jbench render draws"):
        view(Constant(), Scene("face_direction"))
    assert len(closed) == 1


def test_environment_is_closed_if_a_policy_fails(monkeypatch):
    class Failing(Constant):
        def act(self, observations):
            raise ZeroDivisionError

    closed = []
    monkeypatch.setattr(RobotEnv, "close", lambda env: closed.append(env))
    window = contextlib.nullcontext(SimpleNamespace(is_running=lambda: True))
    monkeypatch.setattr(viewer, "_open_window", lambda env: window)
    with pytest.raises(ZeroDivisionError):
        view(Failing(), Scene("face_direction"))
    assert len(closed) == 1


@pytest.mark.parametrize(
    ("scene", "sentence"),
    [
        (Scene(f"{OWN}:Integrator"), "has no MuJoCo physics, which a window shows; type jbench re"),
        (Scene(f"{ODD}:MadeAgain"), "is made again for each episode, and a window shows one mod"),
        (Scene("dmc:cheetah-run", augment=3), "has no augmented robots"),
    ],
)
def test_robot_that_a_window_cannot_show_is_refused(scene, sentence):
    with pytest.raises(RequestError, match=sentence):
        view(Constant(), scene)
