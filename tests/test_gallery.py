"""Tests of the gallery of the README: its animations, and the returns in their captions."""

import re

import pytest
from PIL import Image

from jbench.names import TASKS
from tests.documentation import ROOT
from tests.scripts import script

gallery = script("docs/images/gallery.py")


def test_each_task_has_an_animation_that_loads_fast():
    assert {clip.task for clip in gallery.GALLERY} == set(TASKS)
    for clip in gallery.GALLERY:
        assert clip.path.stat().st_size < 1_000_000
        with Image.open(clip.path) as image:
            assert image.width == 480
            # An image each 0.02 s, slowed down to 0.04.
            assert image.n_frames == clip.steps // 2 + 1


CAPTIONS = {"hand-written": "hand-written policy", "TD3 on planar": "TD3 on `planar`"}
"""What the captions call the policies of the clips."""


@pytest.mark.parametrize(
    "clip",
    [
        pytest.param(
            clip, id=clip.task, marks=() if clip.task == "face_direction" else pytest.mark.slow
        )
        for clip in gallery.GALLERY
    ],
)
def test_caption_has_the_policy_and_the_return_of_its_episode(clip):
    text = (ROOT / "README.md").read_text()
    (caption,) = re.findall(rf"`{clip.task}`, (.*?): return (\d+)", text)
    assert caption[0] == CAPTIONS[clip.name]
    # On another processor an episode ends a little differently.
    assert gallery.whole_return(clip) == pytest.approx(float(caption[1]), abs=100)
