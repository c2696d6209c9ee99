"""Tests of videos, animations and strips, whose frames must equal the episode's pictures."""

import importlib.util
import io

import numpy as np
import pytest
from PIL import Image

from jbench.errors import RequestError
from jbench.rendering import write
from jbench.rendering.episode import Scene, render_episode, strip_picture, video_picture
from jbench.rendering.write import mp4, render_to_file
from tests.rendering.render_policies import Constant

SCENE = Scene("move_to_pose", seed=1, width=160, height=120)
rendering = pytest.mark.usefixtures("coarse_pictures")


def pictures(steps, draw):
    return [draw(frame) for frame in render_episode(Constant(), SCENE, steps)]


def hide(monkeypatch, names):
    """Makes packages look as if they were not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n in names else find(n))


@rendering
@pytest.mark.parametrize(
    ("steps", "shown"),
    [(16, [0, 3, 6, 10, 13, 16]), pytest.param(2, [0, 1, 2], marks=pytest.mark.slow)],
)
def test_strip_has_moments_side_by_side(tmp_path, steps, shown):
    path = tmp_path / "new" / "strip.png"
    last = render_to_file(Constant(), SCENE, path, name="constant", steps=steps)
    np.testing.assert_array_equal(Image.open(path), np.hstack(pictures(shown, strip_picture)))
    assert (last.time, last.episode_return > 0) == (steps * 0.01, True)


@rendering
def test_gif_loops_episode_in_real_time(tmp_path, monkeypatch):
    hide(monkeypatch, ["imageio_ffmpeg"])  # which only videos need
    path = tmp_path / "episode.GIF"
    last = render_to_file(Constant(), SCENE, path, name="half power", steps=16)
    animation = Image.open(path)
    assert (animation.n_frames, animation.size) == (5, (160, 120))
    assert animation.info["loop"] == 0
    assert last.time == 0.16
    about = ("move_to_pose, half power", "tracking camera, 1 check = 1 cm")
    for index, expected in enumerate(pictures(range(0, 17, 4), lambda f: video_picture(f, *about))):
        animation.seek(index)
        assert animation.info["duration"] == 40  # ms
        shown = np.asarray(animation.convert("RGB")).astype(int)
        assert np.abs(shown - expected).mean() < 6  # of 255: 256 colors are enough


@rendering
def test_mp4_shows_episode_in_slow_motion(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "episode.mp4"
    reported = []
    render_to_file(Constant(), SCENE, path, name="x", steps=16, speed=0.5, progress=reported.append)
    about, *shown = ffmpeg.read_frames(str(path))
    assert (about["size"], about["fps"], about["codec"]) == ((160, 120), 25, "h264")
    assert len(shown) == 9  # every other of 16 control steps
    assert reported == list(range(17))
    steps = range(0, 17, 2)
    for content, frame in zip(shown, render_episode(Constant(), SCENE, steps), strict=True):
        note = "tracking camera, 1 check = 1 cm, 0.5 x real time"
        expected = video_picture(frame, "move_to_pose, x", note).astype(int)
        found = np.frombuffer(content, np.uint8).reshape(120, 160, 3)
        assert np.abs(found - expected).mean() < 8


def test_odd_video_size_is_padded_to_even(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    gray = np.full((65, 97, 3), 128, np.uint8)
    (tmp_path / "odd.mp4").write_bytes(mp4(iter([gray] * 3)))
    about, *shown = ffmpeg.read_frames(str(tmp_path / "odd.mp4"))
    assert (about["size"], about["fps"], len(shown)) == ((98, 66), 25, 3)
    assert np.abs(np.frombuffer(shown[1], np.uint8).astype(int) - 128).max() < 4


def test_animation_keeps_colors_of_late_frames():
    blue, green = np.zeros((2, 40, 60, 3), np.uint8)
    blue[...], green[...] = (60, 100, 160), (40, 160, 80)
    animation = Image.open(io.BytesIO(write.gif([blue, blue + 1, green])))
    animation.seek(animation.n_frames - 1)
    assert np.abs(np.asarray(animation.convert("RGB")).astype(int) - green).max() < 8


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(0.04, [40, 40, 40, 40]), (0.045, [40, 50, 50, 40]), (0.0375, [40, 40, 30, 40])],
)
def test_animation_lasts_as_long_as_its_pictures_are_apart(seconds, shown):
    pictures = np.random.default_rng(0).integers(0, 256, (4, 20, 30, 3)).astype(np.uint8)
    animation = Image.open(io.BytesIO(write.gif(pictures, seconds)))
    found = []
    for place in range(animation.n_frames):
        animation.seek(place)
        found.append(animation.info["duration"])
    assert found == shown  # ms, of which a GIF counts tens


@rendering
@pytest.mark.parametrize("ending", write.SUFFIXES)
def test_interrupted_writing_keeps_old_file(tmp_path, ending):
    if ending == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / f"episode{ending}"
    path.write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt):
        render_to_file(Constant(fails_at=6), SCENE, path, name="x", steps=12)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"before"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("film.avi", "film.avi: nothing writes such files; end the name in .mp4, .gif or .png."),
        ("film", "film: nothing writes such files; end the name in .mp4, .gif or .png."),
        ("directory.png", "directory.png is a directory; name a file."),
        ("file/a.png", "file is a file, or lies in one; name a directory."),
    ],
)
def test_invalid_file_is_refused_before_simulation(tmp_path, name, sentence):
    (tmp_path / "directory.png").mkdir()
    (tmp_path / "file").touch()
    policy = Constant()
    with pytest.raises(RequestError) as caught:
        render_to_file(policy, SCENE, tmp_path / name, name="x")
    assert sentence in str(caught.value)
    assert policy.robots == []


@pytest.mark.parametrize(
    ("ending", "missing", "named"),
    [
        (".mp4", ["imageio_ffmpeg"], ".mp4 needs imageio_ffmpeg: "),
        (".mp4", ["imageio", "imageio_ffmpeg"], ".mp4 needs imageio and imageio_ffmpeg: "),
        (".gif", ["imageio"], ".gif needs imageio: "),
    ],
)
def test_missing_library_is_named(tmp_path, monkeypatch, ending, missing, named):
    hide(monkeypatch, missing)
    with pytest.raises(RequestError) as caught:
        render_to_file(Constant(), SCENE, tmp_path / f"a{ending}", name="x")
    assert str(caught.value) == f"{named}type pip install 'jbench[render]'."
