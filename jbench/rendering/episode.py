"""Rendering an episode of a policy as images."""

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.names import CAMERAS, CONTROL_TIMESTEP, EPISODE_STEPS, TASKS, known
from jbench.policies.find import ActingPolicy
from jbench.tasks import features
from jbench.tasks.gym import JitterbugEnv

Picture = NDArray[np.uint8]
"""(height, width, 3), red, green and blue in [0, 255]."""

# Fewer than the model's default: without a GPU an image takes half the time and looks the same.
# With 4096, dots appear in the corners of the overhead view.
_SHADOW_TEXELS = 5120

_SIDES = (64, 4096)  # minimum and maximum width and height in pixels
_SPEEDS = (0.05, 10.0)  # minimum and maximum speed of a video; 1 is real time


@dataclass(frozen=True)
class Scene:
    """An episode and a camera.

    Attributes:
        seed: of the initial pose and the target.
        camera: one of `jbench.names.CAMERAS`.
        width: in pixels.
        height: in pixels.
        augment: seed of an augmented robot's morphology, or None for the plain robot.

    Raises:
        RequestError: if the task or camera does not exist, or the size is out of range.
    """

    task: str
    seed: int = 0
    camera: str = "tracking"
    width: int = 640
    height: int = 480
    augment: int | None = None

    def __post_init__(self) -> None:
        known("task", self.task, TASKS)
        known("camera", self.camera, CAMERAS)
        smallest, largest = _SIDES
        if not all(smallest <= side <= largest for side in (self.width, self.height)):
            raise RequestError(
                f"No picture of {self.width} x {self.height} pixels; each side has {smallest} to "
                f"{largest}."
            )


@dataclass(frozen=True)
class Frame:
    """One image of an episode.

    Attributes:
        step: control steps since the start.
        episode_return: sum of the rewards so far.
        goal: distance and direction of the target as text.
        picture: image without text.
    """

    step: int
    episode_return: float
    goal: str
    picture: Picture

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.step * CONTROL_TIMESTEP


def render_episode(
    policy: ActingPolicy,
    scene: Scene,
    at: Collection[int],
    progress: Callable[[int], object] = lambda steps: None,
) -> Iterator[Frame]:
    """Simulates an episode and yields images of some of its control steps in order.

    Args:
        at: control steps, starting at 0 (the initial state); the episode ends at the last one.
        progress: called with the number of completed control steps.
    """
    env = JitterbugEnv(
        scene.task,
        render_mode="rgb_array",
        camera=scene.camera,
        width=scene.width,
        height=scene.height,
        augment=scene.augment,
    )
    env.model.vis.quality.shadowsize = _SHADOW_TEXELS
    try:
        observation, _ = env.reset(seed=scene.seed)
        policy.reset(1)
        episode_return = 0.0
        for step in range(max(at) + 1):
            if step:
                action = np.asarray(policy.act(observation[None])[0], np.float32)
                observation, reward, *_ = env.step(action)
                episode_return += reward
            if step in at:
                yield Frame(step, episode_return, goal(scene.task, observation), env.render())
            progress(step)
    finally:
        env.close()


def video_steps(
    frames_per_second: float, speed: float = 1.0, steps: int = EPISODE_STEPS
) -> tuple[Collection[int], float]:
    """Returns the control steps of a video's frames and the seconds between frames.

    Frames are a whole number of control steps apart, so the speed is exact and the frame rate is
    rounded: in real time, 30 frames a second become 33.3.

    Args:
        speed: 1 for real time, 0.5 for half speed.

    Raises:
        RequestError: if speed, frame rate or steps are out of range.
    """
    if not _SPEEDS[0] <= speed <= _SPEEDS[1]:
        raise RequestError(f"No speed {speed:g}; there are {_SPEEDS[0]:g} to {_SPEEDS[1]:g}.")
    _check_steps(steps)
    max_rate = round(speed / CONTROL_TIMESTEP, 6)  # 29 at speed 0.29, not 28.999999999999996
    if not 1 <= frames_per_second <= max_rate:
        raise RequestError(
            f"No video of {frames_per_second:g} frames a second; there are 1 to {max_rate:g}."
        )
    stride = round(max_rate / frames_per_second)
    return range(0, steps + 1, stride), stride * CONTROL_TIMESTEP / speed


def strip_steps(moments: int, steps: int = EPISODE_STEPS) -> Collection[int]:
    """Returns the control steps of equally spaced moments, from the first to the last.

    Raises:
        RequestError: if there are fewer than two moments, or more than steps.
    """
    _check_steps(steps)
    if not 2 <= moments <= steps + 1:
        raise RequestError(f"No strip of {moments} moments in {steps} control steps.")
    return [round(moment * steps / (moments - 1)) for moment in range(moments)]


def _check_steps(steps: int) -> None:
    if not 1 <= steps <= EPISODE_STEPS:
        raise RequestError(f"An episode has 1 to {EPISODE_STEPS} control steps, not {steps}.")


def goal(task: str, observation: NDArray[np.floating]) -> str:
    """Describes the remaining distance and angle to the goal of an observation (dim(O),).

    Distances are horizontal. Numbers are padded with figure spaces to a fixed width.
    """
    physical = features.denormalize(task, np.asarray(observation, np.float64))
    by_name = features.split(task, physical)
    if task == "move_from_origin":
        return f"{_centimetres(by_name['position'])} from the origin"
    if task == "move_in_direction":
        speed = 100 * by_name["speed_in_target_frame"][0]
        return f"{padded(f'{speed:.1f}', 5)} cm/s as the target points"
    words = []
    if "target_in_jitterbug_frame" in by_name:
        words.append(f"target {_centimetres(by_name['target_in_jitterbug_frame'])} away")
    if "angle_to_target" in by_name:
        angle = math.degrees(by_name["angle_to_target"][0])
        side = "left" if angle > 0 else "right"
        words.append(f"turn {padded(f'{abs(angle):.0f}', 3)}° {side}")
    return ", ".join(words)


def _centimetres(vector: NDArray[np.float64]) -> str:
    """Returns the horizontal length of a vector (3 or more,) in metres."""
    return f"{padded(f'{100 * math.hypot(vector[0], vector[1]):.1f}', 4)} cm"


def padded(number: str, width: int) -> str:
    """Returns a number with figure spaces before it, which are as wide as digits."""
    return number.rjust(width, "\N{FIGURE SPACE}")
