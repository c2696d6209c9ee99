"""Tests of `jbench evaluate`, `jbench render` and `jbench view`."""

import json
import os
import re
import subprocess
import sys
from functools import partial

import pytest
from PIL import Image

from tests import command_line
from tests.command_line import SHORT, train

jbench = partial(command_line.jbench, short=True)
succeed = partial(command_line.succeed, short=True)


@pytest.fixture(scope="module")
def augmented(tmp_path_factory):
    """A results directory with a run on an augmented robot, and the run's id."""
    results = tmp_path_factory.mktemp("augmented")
    short = ("--steps", str(SHORT), "--evaluate-episodes", "0", "--jobs", "1")
    done = succeed(
        *train("ddpg", "none", "--augment", "7", "--seeds", "0", "--json", *short), results=results
    )
    return results, json.loads(done.stdout)["runs"][0]


def test_evaluation_on_other_robot_prints_notice(augmented):
    results, run = augmented
    task = ("--task", "face_direction", run, "--episodes", "1")
    other = succeed("evaluate", *task, results=results).stdout
    assert f"{run} was trained on augmented robot 7, but this is the plain robot" in other
    assert "type --augment 7 for its robot" in other
    assert (
        "was trained on" not in succeed("evaluate", *task, "--augment", "7", results=results).stdout
    )


@pytest.mark.parametrize(("episodes", "tails"), [("9", False), ("10", True)])
def test_percentiles_are_of_ten_episodes_or_more(episodes, tails, tmp_path):
    printed = succeed("evaluate", "random", "--episodes", episodes, results=tmp_path).stdout
    assert "median return" in printed
    assert ("[10th" in printed) == tails


@pytest.mark.usefixtures("rendering")
def test_render_writes_reported_file(tmp_path):
    out = tmp_path / "strip.png"
    done = succeed(
        "render", "--out", str(out), "--steps", "20", "--json", results=tmp_path / "none"
    )
    output = json.loads(done.stdout)
    assert output["path"] == str(out)
    assert 0 <= output["episode_return"] <= 20
    width, height = Image.open(out).size
    assert width > 2 * height
    assert not (tmp_path / "none").exists()  # pictures are not results


@pytest.mark.usefixtures("rendering")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--camera", "sky"), "Unknown camera 'sky'; choose"),
        (("--out", "film.avi"), r"\.mp4.*\.gif.*\.png"),
        (("--augment", "-1"), "'--augment': Input should be greater"),
    ],
)
def test_invalid_picture_is_refused(arguments, message, tmp_path, refused):
    assert re.search(message, refused("render", *arguments, results=tmp_path / "results"))
    assert not (tmp_path / "results").exists()


@pytest.mark.usefixtures("rendering")
def test_trained_policy_is_rendered_in_its_task(augmented, tmp_path):
    results, run = augmented  # of face_direction; move_to_pose is the default of render
    out = ("--steps", "20", "--out", str(tmp_path / "strip.png"))
    done = succeed("render", run, *out, results=results)
    assert f"render {run} face_direction" in done.stderr


def test_run_of_other_task_is_refused(augmented):
    results, run = augmented
    for verb in (("evaluate",), ("render", "--steps", "20")):
        done = jbench(*verb, "--task", "move_to_pose", run, results=results)
        assert done.returncode == 2
        assert (
            "was trained on face_direction, not move_to_pose; type --task face_direction"
            in done.stderr
        )


def test_render_without_backend_prints_one_error_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "jbench", "render", "--out", str(tmp_path / "film.png")],
        env={**os.environ, "MUJOCO_GL": "glfw", "DISPLAY": ":77"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_view_without_display_names_render_command(tmp_path):
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "jbench", "view"], env=bare, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "There is no display to open a window on; jbench render" in done.stderr
