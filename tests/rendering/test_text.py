"""Tests of text in pictures: position, legibility and content."""

import numpy as np
import pytest

from jbench.rendering.episode import Frame, times, video_picture, write
from tests.rendering.render_policies import PAD

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
    ("change", "line"),
    [({"time": 2.6}, 1), ({"episode_return": 99.0}, 1), ({"goal": "other"}, 2)],
)
def test_each_line_shows_its_value(change, line):
    one, other = (video_picture(f, "title", "ego camera") for f in (frame(), frame(**change)))
    first, last = changed_rows(one, other)
    assert MARGIN + line * LINE <= first <= last < MARGIN + (line + 1) * LINE


def test_numbers_have_fixed_width():
    assert times(frame()) == f"{PAD}2.50 s   return {PAD}{PAD}12.3"
    assert times(frame(10.0, 914.37)) == "10.00 s   return" + f" {PAD}914.4"


def test_small_pictures_keep_legible_letters():
    rows = changed_rows(write(plain(0, 64, 64), ["8"], [], lines_in_height=24), plain(0, 64, 64))
    assert rows[1] - rows[0] >= 8
