"""Text in images: task, policy, time, return and goal."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from jbench.rendering.episode import Frame, Picture
from jbench.tasks.labels import padded

SCALE = "1 check = 1 cm"

_TEXT = (255, 255, 255)
_OUTLINE = (16, 24, 40)
_MIN_SIZE = 11  # pixels of legible text


def video_picture(frame: Frame, title: str, note: str) -> Picture:
    """Returns a copy of a frame's image with text.

    Args:
        title: first line, with task and policy.
        note: bottom line, with camera and speed.
    """
    above = [title, times(frame), frame.goal]
    return write(frame.picture, above, [note], lines_in_height=24)


def strip_picture(frame: Frame) -> Picture:
    """Returns a frame's image for a strip, with time and return in larger text."""
    above = [f"{frame.time:.1f} s", f"return {frame.episode_return:.0f}"]
    return write(frame.picture, above, [], lines_in_height=11)


def times(frame: Frame) -> str:
    """Returns time and return so far with a fixed width."""
    time, so_far = padded(f"{frame.time:.2f}", 5), padded(f"{frame.episode_return:.1f}", 6)
    return f"{time} s   return {so_far}"


def write(
    picture: Picture, above: Sequence[str], below: Sequence[str], *, lines_in_height: int
) -> Picture:
    """Returns a copy of an image (height, width, 3) with left-aligned lines of text.

    Args:
        above: lines at the top.
        below: lines at the bottom.
        lines_in_height: determines the text size: number of lines in the image's height or three
            quarters of its width, whichever is less.
    """
    height, width, _ = picture.shape
    size = max(_MIN_SIZE, round(min(height, 0.75 * width) / lines_in_height))
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    line, margin = round(1.3 * size), size // 2
    tops = [margin + line * row for row in range(len(above))]
    tops += [height - margin - line * (len(below) - row) for row in range(len(below))]
    for top, text in zip(tops, (*above, *below), strict=True):
        # An outline is legible on any background and hides less than a box.
        draw.text(
            (margin, top),
            text,
            fill=_TEXT,
            font=_font(size),
            stroke_width=max(1, round(size / 9)),
            stroke_fill=_OUTLINE,
        )
    return np.array(image)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Returns the font that matplotlib ships, which is always available."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size)
