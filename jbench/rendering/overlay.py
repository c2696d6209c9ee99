"""Text in pictures: what is done by whom, the time, the return so far and what is left to do."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from jbench.rendering.episode import Frame, Picture

SCALE = "1 check = 1 cm"

_TEXT = (255, 255, 255)
_OUTLINE = (16, 24, 40)
_SMALLEST = 11  # pixels from which letters are legible


def video_picture(frame: Frame, title: str, note: str) -> Picture:
    """Returns a frame's picture with everything written in.

    Args:
        frame: left as it is.
        title: the first line: task and policy.
        note: the line at the bottom: camera and speed; the floor's scale is added.
    """
    above = [title, times(frame), frame.goal]
    return write(frame.picture, above, [f"{note}, {SCALE}"], lines_in_height=24)


def strip_picture(frame: Frame) -> Picture:
    """Returns a frame's picture with time and return in larger letters, as part of a strip."""
    above = [f"{frame.time:.1f} s", f"return {frame.episode_return:.0f}"]
    return write(frame.picture, above, [], lines_in_height=11)


def times(frame: Frame) -> str:
    """Returns the time and the return so far, always equally wide."""
    time, so_far = f"{frame.time:.2f}", f"{frame.episode_return:.1f}"
    pad = "\N{FIGURE SPACE}"
    return f"{time.rjust(5, pad)} s   return {so_far.rjust(6, pad)}"


def write(
    picture: Picture, above: Sequence[str], below: Sequence[str], *, lines_in_height: int
) -> Picture:
    """Returns a picture with lines of text at its left, from the top and from the bottom.

    Args:
        picture: (height, width, 3), left as it is.
        above: lines at the top.
        below: lines at the bottom.
        lines_in_height: how many lines would fill a picture as high as three quarters of its
            width, or as the picture is, whichever is less.
    """
    height, width, _ = picture.shape
    size = max(_SMALLEST, round(min(height, 0.75 * width) / lines_in_height))
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    line, margin = round(1.3 * size), size // 2
    tops = [margin + line * row for row in range(len(above))]
    tops += [height - margin - line * (len(below) - row) for row in range(len(below))]
    for top, text in zip(tops, (*above, *below), strict=True):
        # An outline and not a box: it is legible on everything and hides next to nothing.
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
    """Returns matplotlib's own font: no other is sure to be on a machine."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size)
