"""Tests of rendered frames, against the same episode without rendering, and of their text."""

import itertools

import numpy as np
import pytest

from jbench.rendering.episode import (
    Frame,
    Scene,
    _font,
    broken,
    render_episode,
    strip_picture,
    times,
    video_picture,
    with_text,
)
from jbench.task_specs import CAMERAS
from jbench.tasks.gym import RobotEnv
from jbench.tasks.jitterbug import features, geometry, resets
from jbench.tasks.jitterbug.features import goal
from jbench.tasks.pictures import Artist
from tests.rendering.render_policies import PAD, Constant

SMALL = {"width": 96, "height": 64}


@pytest.mark.usefixtures("coarse_pictures")
def test_frames_equal_episode_without_rendering():
    policy = Constant()
    frames = list(render_episode(policy, Scene("move_from_origin", seed=3, **SMALL), [0, 5, 12]))
    env = RobotEnv("move_from_origin")
    seen, returns = [env.reset(seed=3)[0]], [0.0]
    for _ in range(12):
        observation, reward, *_ = env.step(np.full(1, 0.5, np.float32))
        seen.append(observation)
        returns.append(returns[-1] + reward)
    assert returns[12] > returns[5] > 0
    assert [frame.time for frame in frames] == [0, 0.05, 0.12]
    assert [frame.episode_return for frame in frames] == [returns[0], returns[5], returns[12]]
    assert [frame.goal for frame in frames] == [
        goal("move_from_origin", seen[i]) for i in (0, 5, 12)
    ]
    np.testing.assert_array_equal(policy.observations, seen[:12])  # one per step
    assert policy.robots == [1]
    assert {frame.picture.shape for frame in frames} == {(64, 96, 3)}
    for one, other in itertools.combinations(frames, 2):
        assert np.any(one.picture != other.picture)


@pytest.mark.usefixtures("rendering")
def test_drawing_changes_no_reward_and_no_observation():
    """The reward of this robot has its position before the last physics step."""
    seen = []
    for mode in (None, "rgb_array"):
        env = RobotEnv("gym:Ant-v5", mode, width=8, height=8)
        observation, _ = env.reset(seed=3)
        seen.append([observation])
        for _ in range(5):
            env.render()
            observation, reward, *_ = env.step(np.full(8, 0.5))
            seen[-1].append(np.append(observation, reward))

        env.close()

    for one, other in zip(*seen, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.usefixtures("rendering")
def test_environment_that_makes_its_model_again_is_drawn_by_one_renderer(monkeypatch):
    closed = []
    close = Artist.close
    monkeypatch.setattr(Artist, "close", lambda artist: (closed.append(artist), close(artist)))
    env = RobotEnv("tests.mistaken_gym_tasks:rebuilt", "rgb_array", width=8, height=8)
    for episode in range(3):
        env.reset(seed=episode)
        assert env.render().shape == (8, 8, 3)
        assert len(closed) == episode

    env.close()
    assert len(set(closed)) == 3


@pytest.mark.usefixtures("coarse_pictures")
def test_scene_determines_picture():
    scenes = [Scene("face_direction", camera=camera, **SMALL) for camera in CAMERAS]
    scenes += [
        Scene("face_direction", seed=1, **SMALL),
        Scene("face_direction", augment=1, **SMALL),
    ]
    pictures = [next(render_episode(Constant(), scene, [0])).picture for scene in scenes]
    for one, other in itertools.combinations(pictures, 2):
        assert np.mean(one != other) > 0.02


@pytest.mark.usefixtures("rendering")
def test_overhead_camera_shows_target_at_its_position(monkeypatch):
    target = geometry.Target(np.array([0.1, -0.05, 0.035]), np.float64(0))
    monkeypatch.setattr(resets, "draw_target", lambda task, random: target)
    scene = Scene("move_to_position", camera="overhead", width=320, height=240)
    red, green, blue = next(render_episode(Constant(), scene, [0])).picture.astype(int).T
    columns, rows = np.nonzero((green > red + 30) & (green > blue + 10))
    # The camera at 0.75 m sees 2 tan 20° * 0.715 m = 0.5205 m in 240 rows: 461.1 per meter. The
    # target, 4.6 pixels in radius, is 46.1 pixels right of the middle and 23.1 below it.
    assert np.hypot(np.median(columns) - (160 + 46.1), np.median(rows) - (120 + 23.1)) < 4.6
    assert 20 < len(rows) < 140  # a disc of 66 pixels, a pointer, and its edges


@pytest.mark.parametrize(
    ("task", "values", "words"),
    [
        ("move_from_origin", {0: 0.03, 1: -0.04}, "_5.0 cm from the origin"),
        ("face_direction", {15: np.radians(30)}, "turn _30° left"),
        ("face_direction", {15: np.radians(-179)}, "turn 179° right"),
        ("move_in_direction", {16: 0.123}, "_12.3 cm/s as the target points"),
        ("move_to_position", {15: -0.12, 16: 0.05, 17: 0.01}, "target 13.0 cm away"),
        (
            "move_to_pose",
            {15: 0.003, 16: 0.004, 18: np.radians(5)},
            "target _0.5 cm away, turn __5° left",
        ),
    ],
)
def test_goal_is_described_in_words(task, values, words):
    physical = np.zeros(features.observation_size(task))
    physical[list(values)] = list(values.values())
    assert goal(task, features.normalize(task, physical)) == words.replace("_", PAD)


@pytest.mark.usefixtures("rendering")
def test_another_robot_is_drawn_by_its_first_camera_or_a_named_one():
    first, fixed, above, free = (
        list(
            render_episode(Constant(), Scene("dmc:cartpole-swingup", camera=name, **SMALL), [0, 9])
        )
        for name in (None, "fixed", "lookatcart", "free")
    )
    for one, other in zip(first, fixed, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
    assert (first[0].picture != first[1].picture).any()
    assert (first[1].picture != above[1].picture).any()
    assert (first[1].picture != free[1].picture).any()
    assert [frame.time for frame in first] == [0, 0.09]
    assert first[1].goal == ""


@pytest.mark.slow
@pytest.mark.usefixtures("rendering")
def test_terrain_of_a_later_episode_is_that_which_is_drawn():
    first, second = (
        RobotEnv("dmc:quadruped-escape", "rgb_array", width=64, height=48) for _ in range(2)
    )
    first.reset(seed=0)
    before = first.render()
    for env in (first, second):
        env.reset(seed=1)
    after = first.render()
    np.testing.assert_array_equal(after, second.render())
    assert (after != before).any()
    first.close()
    second.close()


HEIGHT, WIDTH = 480, 640
LINE = 26  # 1.3 times the letters' 480 / 24 = 20 pixels
MARGIN = 10


def plain(gray=128, height=HEIGHT, width=WIDTH):
    return np.full((height, width, 3), gray, np.uint8)


def frame(time=2.5, episode_return=12.34, goal="target"):
    return Frame(time, episode_return, goal, plain())


def changed_rows(one, other):
    """First and last row in which two pictures differ."""
    rows = np.nonzero(np.any(one != other, axis=(1, 2)))[0]
    return rows.min(), rows.max()


def test_text_changes_only_its_lines():
    shown = frame()
    written = video_picture(shown, "face_direction, heuristic", "ego camera")
    np.testing.assert_array_equal(shown.picture, plain())  # unchanged
    touched = np.any(written != 128, axis=2)
    top, bottom = MARGIN + 3 * LINE, HEIGHT - MARGIN - LINE
    assert not touched[top:bottom].any()
    assert not touched[:, WIDTH - 200 :].any()
    for first in (MARGIN, MARGIN + LINE, MARGIN + 2 * LINE, bottom):
        line = written[first : first + LINE]
        assert np.all(line == 255, axis=2).sum() > 100  # letters
        assert np.all(line == (16, 24, 40), axis=2).sum() > 100  # their outline


@pytest.mark.parametrize(
    ("change", "line"), [({"time": 2.6}, 1), ({"episode_return": 99.0}, 1), ({"goal": "other"}, 2)]
)
def test_each_line_shows_its_value(change, line):
    one, other = (video_picture(f, "title", "ego camera") for f in (frame(), frame(**change)))
    first, last = changed_rows(one, other)
    assert MARGIN + line * LINE <= first <= last < MARGIN + (line + 1) * LINE


def test_numbers_have_fixed_width():
    assert times(frame()) == f"{PAD}2.50 s   return {PAD}{PAD}12.3"
    assert times(frame(10.0, 914.37)) == "10.00 s   return" + f" {PAD}914.4"


@pytest.mark.parametrize(
    ("episode_return", "running", "in_strip"),
    [
        (672.44, "672.4", "672"),
        (-1234.56, "-1234.6", "-1,235"),
        (0.3, "0.3", "0.3"),
        (-0.0234, "-0.023", "-0.023"),
        (2.5e12, "2.5e+12", "2.5e+12"),
    ],
)
def test_returns_of_any_size_are_shown(episode_return, running, in_strip):
    shown = frame(episode_return=episode_return)
    assert times(shown).split()[-1].strip(PAD) == running
    written = with_text(plain(), ["2.5 s", f"return {in_strip}"], [], lines_in_height=11)
    np.testing.assert_array_equal(strip_picture(shown), written)


def test_small_pictures_keep_legible_letters():
    rows = changed_rows(
        with_text(plain(0, 64, 64), ["8"], [], lines_in_height=24), plain(0, 64, 64)
    )
    assert rows[1] - rows[0] >= 8


def test_lines_wider_than_the_picture_are_broken():
    text = "gym:lab:Own/Walker-v0,mass=2, gym.lab.Own/Walker-v0.mass.2/td3/dae12/s00-12345678"
    lines = broken(text, 11, 200)
    assert "".join(lines) == text
    assert len(lines) > 2
    assert all(line[-1] in " /," for line in lines[:-1])
    assert max(_font(11).getlength(line.rstrip()) for line in lines) <= 200
    assert broken(text, 11, 2000) == [text]
    assert broken("", 11, 200) == [""]
    assert broken("x" * 99, 11, 200) == ["x" * 99]
    # The second line is drawn below the first.
    black = np.zeros((100, 200, 3), np.uint8)
    once, twice = (with_text(black, ["ab " * n], [], lines_in_height=9) for n in (1, 30))
    assert not once[30:].any()
    assert twice[30:60].any()
