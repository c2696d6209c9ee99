"""Tests of `jbench evaluate`, `jbench render` and `jbench view`."""

import json
import re
from functools import partial

import pytest
from PIL import Image

from jbench.commands.policies import video_name
from jbench.tasks.find import find_task
from tests import command_line
from tests.command_line import SHORT, train
from tests.short_episodes import shorten_episodes

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


def test_evaluation_on_other_robot_prints_notice(augmented, run_command, monkeypatch):
    shorten_episodes(monkeypatch.setattr, 20)
    results, run = augmented
    typed = ("evaluate", "--task", "face_direction", run, "--episodes")
    code, other, _ = run_command(*typed, "9", results=results)
    assert code == 0
    assert f"{run} was trained on augmented robot 7, but this is the plain robot" in other
    assert "type --augment 7 for its robot" in other
    code, same, _ = run_command(*typed, "10", "--augment", "7", results=results)
    assert code == 0
    assert "was trained on" not in same
    # Percentiles are of ten episodes or more.
    assert "mean return" in other
    assert ("[10th" in other, "[10th" in same) == (False, True)


@pytest.mark.usefixtures("coarse_pictures")
def test_render_writes_reported_file(augmented, run_command, tmp_path):
    results, run = augmented
    before = sorted(results.rglob("*"))
    out = tmp_path / "strip.png"
    typed = ("render", run, "--out", str(out), "--steps", "20", "--json")
    code, printed, said = run_command(*typed, results=results)
    # The task is that of the run, not render's default.
    assert (code, f"render {run} face_direction" in said) == (0, True)
    output = json.loads(printed)
    assert output["path"] == str(out)
    assert 0 <= output["episode_return"] <= 20
    width, height = Image.open(out).size
    assert width > 2 * height
    assert sorted(results.rglob("*")) == before  # pictures are not results


@pytest.mark.parametrize(
    ("robot", "name"),
    [
        (find_task("face_direction").robot, "jitterbug.mp4"),
        ("dmc:cheetah-run", "dmc.cheetah-run.mp4"),
        ("gym:mine/Falls-v0,mass=2", "gym.mine.Falls-v0.mass.2.mp4"),
    ],
)
def test_videos_of_two_robots_have_two_names(robot, name):
    assert video_name(robot) == name


@pytest.mark.usefixtures("rendering")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--camera", "sky"), "choose overhead, tracking, ego, spectator or free."),
        (("--out", "film.avi"), r"\.mp4.*\.gif.*\.png"),
        (("--augment", "-1"), "'--augment': '-1': type a whole number, such as 0"),
    ],
)
def test_invalid_picture_is_refused(arguments, message, tmp_path, refused):
    assert re.search(message, refused("render", *arguments, results=tmp_path / "results"))
    assert not (tmp_path / "results").exists()


@pytest.mark.usefixtures("rendering")
def test_run_of_other_task_is_refused(augmented, refused):
    results, run = augmented
    for verb in ("evaluate", "render"):
        error = refused(verb, "--task", "move_to_pose", run, "--augment", "7", results=results)
        sentence = "was trained on face_direction, not move_to_pose; type --task face_direction"
        assert sentence in error
