"""Tests of rendered frames, against the same episode without rendering."""

import itertools

import numpy as np
import pytest

from jbench.errors import RequestError
from jbench.names import CAMERAS
from jbench.rendering.episode import Scene, goal, render_episode, strip_steps, video_steps
from jbench.tasks import features, resets
from jbench.tasks.gym import JitterbugEnv
from tests.rendering.render_policies import PAD, Constant

SMALL = {"width": 96, "height": 64}


@pytest.mark.usefixtures("coarse_pictures")
def test_frames_equal_episode_without_rendering():
    policy = Constant()
    frames = list(render_episode(policy, Scene("move_from_origin", seed=3, **SMALL), [0, 5, 12]))
    env = JitterbugEnv("move_from_origin")
    seen, returns = [env.reset(seed=3)[0]], [0.0]
    for _ in range(12):
        observation, reward, *_ = env.step(np.full(1, 0.5, np.float32))
        seen.append(observation)
        returns.append(returns[-1] + reward)
    assert returns[12] > returns[5] > 0
    assert [frame.step for frame in frames] == [0, 5, 12]
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
    target = features.Target(np.array([0.1, -0.05, 0.035]), np.float64(0))
    monkeypatch.setattr(resets, "draw_target", lambda task, random: target)
    scene = Scene("move_to_position", camera="overhead", width=320, height=240)
    red, green, blue = next(render_episode(Constant(), scene, [0])).picture.astype(int).T
    columns, rows = np.nonzero((green > red + 30) & (green > blue + 10))
    # The camera at 0.75 m sees 2 tan 20° * 0.715 m = 0.5205 m in 240 rows: 461.1 per metre. The
    # target, 4.6 pixels in radius, is 46.1 pixels right of the middle and 23.1 below it.
    assert np.hypot(np.median(columns) - (160 + 46.1), np.median(rows) - (120 + 23.1)) < 4.6
    assert 20 < len(rows) < 140  # a disc of 66 pixels, a pointer, and its edges


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"task": "fly"}, "Unknown task 'fly'"),
        ({"camera": "trackin"}, "Unknown camera 'trackin'; did you mean tracking?"),
        ({"width": 63}, "No picture of 63 x 480 pixels"),
        ({"height": 5000}, "No picture of 640 x 5000 pixels; each side has 64 to 4096."),
    ],
)
def test_invalid_scene_is_refused(settings, sentence):
    with pytest.raises(RequestError) as caught:
        Scene(**{"task": "face_direction"} | settings)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("settings", "steps", "interval"),
    [
        ((25,), range(0, 1001, 4), 0.04),
        ((30,), range(0, 1001, 3), 0.03),  # a whole number of control steps apart
        ((100, 1.0, 7), range(8), 0.01),
        ((25, 0.5, 100), range(0, 101, 2), 0.04),  # slow motion: more frames
        ((25, 2.0, 100), range(0, 101, 8), 0.04),
        ((29, 0.29, 100), range(101), 1 / 29),  # the highest rate, although 0.29 / 0.01 < 29
    ],
)
def test_video_steps_have_requested_rate_and_speed(settings, steps, interval):
    assert video_steps(*settings) == (steps, pytest.approx(interval))


def test_strip_spans_first_to_last_step():
    assert strip_steps(6) == [0, 200, 400, 600, 800, 1000]
    assert strip_steps(4, 100) == [0, 33, 67, 100]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: video_steps(101), "No video of 101 frames a second; there are 1 to 100."),
        (lambda: video_steps(60, 0.5), "No video of 60 frames a second; there are 1 to 50."),
        (lambda: video_steps(0), "No video of 0 frames a second"),
        (lambda: video_steps(25, 0), "No speed 0; there are 0.05 to 10."),
        (lambda: video_steps(25, float("nan")), "No speed nan"),
        (lambda: video_steps(25, 1.0, 1001), "An episode has 1 to 1000 control steps, not 1001."),
        (lambda: strip_steps(1), "No strip of 1 moments in 1000 control steps."),
        (lambda: strip_steps(5, 3), "No strip of 5 moments in 3 control steps."),
    ],
)
def test_invalid_video_is_refused(call, sentence):
    with pytest.raises(RequestError) as caught:
        call()
    assert str(caught.value).startswith(sentence)


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
    physical = np.zeros(features.TASK_SPECS[task].observation_size)
    physical[list(values)] = list(values.values())
    assert goal(task, features.normalize(task, physical)) == words.replace("_", PAD)
