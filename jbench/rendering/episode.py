"""An episode of a policy as images, with text in them: task, policy, time, return and goal."""

import contextlib
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps

from jbench.numbers import one_decimal, whole
from jbench.policies.find import ActingPolicy
from jbench.task_specs import CONTROL_TIMESTEP
from jbench.tasks.find import find_task
from jbench.tasks.gym import RobotEnv
from jbench.wording import padded

Picture = NDArray[np.uint8]  # (height, width, 3), red, green and blue in [0, 255]

# Fewer than the model's default: without a GPU an image takes half the time and looks the same.
# With 4096, dots appear in the corners of the overhead view.
_SHADOW_TEXELS = 5120

_MIN_SIZE = 11  # pixels of legible text


@dataclass(frozen=True)
class Scene:
    """An episode and a camera."""

    task: str
    seed: int = 0  # of the initial pose and the target
    camera: str | None = None  # of the robot's model; None for `tracking`, or another's first
    width: int = 640  # in pixels; an environment that draws itself has a size of its own
    height: int = 480  # in pixels
    augment: int | None = None  # seed of an augmented robot; None for the plain robot

    @property
    def timestep(self) -> float:
        """Seconds of a control step, simulated or of its pictures."""
        return find_task(self.task).shown_timestep or CONTROL_TIMESTEP

    def environment(self, render_mode: str | None = "rgb_array") -> RobotEnv:
        """Returns an environment that draws pictures, or with None, does not.

        Raises a RequestError if the robot has no such camera, or is not drawn.
        """
        env = RobotEnv(
            self.task,
            render_mode,
            self.camera,
            self.width,
            self.height,
            self.augment,
        )
        if find_task(self.task).has_physics:
            quality = env.model.vis.quality
            quality.shadowsize = min(quality.shadowsize, _SHADOW_TEXELS)
        return env


class Frame(NamedTuple):
    """One image of an episode."""

    time: float  # seconds since the start
    episode_return: float  # sum of the rewards so far
    goal: str  # distance and direction of the target as text; empty for other robots
    picture: Picture  # image without text


def render_episode(
    policy: ActingPolicy,
    scene: Scene,
    at: Collection[int],
    progress: Callable[[int], object] = lambda steps: None,
) -> Iterator[Frame]:
    """Yields images of the control steps `at`, 0 being the initial state; ends at the last one.

    An episode that ends before has fewer images, and one of its last state. All have the size of
    the first.
    """
    with contextlib.closing(scene.environment()) as env:
        observation, _ = env.reset(seed=scene.seed)
        policy.reset(1)
        first: Picture | None = None
        episode_return = 0.0
        is_over = False
        for step in range(max(at) + 1):
            if step:
                action = np.asarray(policy.act(observation[None])[0], np.float32)
                observation, reward, terminated, truncated, _ = env.step(action)
                episode_return += reward
                is_over = terminated or truncated
            if step in at or is_over:
                words = find_task(scene.task).goal(observation)
                picture = np.asarray(env.render())
                if first is None:
                    first = picture
                picture = fitted(picture, first)
                yield Frame(step * scene.timestep, episode_return, words, picture)

            progress(step)
            if is_over:
                return


def fitted(picture: Picture, other: Picture) -> Picture:
    """Returns a picture in the size of another one.

    It is scaled if its size differs. Black margins keep its proportions.
    """
    if picture.shape == other.shape:
        return picture

    height, width, _ = other.shape
    scaled = ImageOps.pad(Image.fromarray(picture), (width, height))
    return np.array(scaled)


def video_picture(frame: Frame, title: str, note: str) -> Picture:
    """Returns a copy of a frame's image with text: a title above, and a note below."""
    above = [title, times(frame), frame.goal]
    return with_text(frame.picture, above, [note], lines_in_height=24)


def strip_picture(frame: Frame) -> Picture:
    """Returns a frame's image for a strip, with time and return in larger text."""
    above = [f"{frame.time:.1f} s", f"return {whole(frame.episode_return)}"]
    return with_text(frame.picture, above, [], lines_in_height=11)


def times(frame: Frame) -> str:
    """Returns time and return so far with a fixed width."""
    time = padded(f"{frame.time:.2f}", 5)
    so_far = padded(one_decimal(frame.episode_return), 6)
    return f"{time} s   return {so_far}"


def with_text(
    picture: Picture, above: Sequence[str], below: Sequence[str], *, lines_in_height: int
) -> Picture:
    """Returns a copy of an image (height, width, 3) with lines of text above and below.

    The text size is that of a number of lines in the image's height or three quarters of its width,
    whichever is less. Lines that are wider than the image are broken.
    """
    height, width, _ = picture.shape
    size = max(_MIN_SIZE, round(min(height, 0.75 * width) / lines_in_height))
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    line = round(1.3 * size)
    margin = size // 2
    room = width - 2 * margin
    above = [*chain.from_iterable(broken(text, size, room) for text in above)]
    below = [*chain.from_iterable(broken(text, size, room) for text in below)]
    tops = [margin + line * row for row in range(len(above))]
    tops += [height - margin - line * (len(below) - row) for row in range(len(below))]
    style: dict[str, Any] = {
        "font": _font(size),
        "fill": (255, 255, 255),
        # An outline is legible on any background and hides less than a box.
        "stroke_width": max(1, round(size / 9)),
        "stroke_fill": (16, 24, 40),
    }
    for top, text in zip(tops, (*above, *below), strict=True):
        draw.text((margin, top), text, **style)

    return np.array(image)


def broken(text: str, size: int, width: float) -> list[str]:
    """Returns a text in lines that fit a width, with the font in a size, both in pixels.

    Lines end after a space, a slash or a comma; what has none of these is not broken.
    """
    lines = []
    line = ""
    for piece in re.findall(r"[^ /,]*[ /,]|[^ /,]+$", text):
        if line and _font(size).getlength(f"{line}{piece}".rstrip()) > width:
            lines.append(line)
            line = ""
        line += piece
    return [*lines, line]


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Returns the font that matplotlib ships."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size)
