"""An episode of a policy as pictures, with what was true when each was taken."""

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

# Fewer a side than the model asks for: without a GPU a picture takes half the time, and it
# looks the same; with 4096, dots show in the corners of the overhead view.
_SHADOW_TEXELS = 5120

_SIDES = (64, 4096)  # least and most pixels of a side
_SPEEDS = (0.05, 10.0)  # of a video, 1 being real time


@dataclass(frozen=True)
class Scene:
    """Which episode to play and how to look at it.

    Attributes:
        task: one of `jbench.names.TASKS`.
        seed: of the robot's pose and of the target.
        camera: one of `jbench.names.CAMERAS`.
        width: of a picture, in pixels.
        height: of a picture, in pixels.
        augment: seed of an augmented robot's morphology, or None for the plain robot.

    Raises:
        RequestError: if there is no such task or camera, or a side is too short or too long.
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
        shortest, longest = _SIDES
        if not all(shortest <= side <= longest for side in (self.width, self.height)):
            raise RequestError(
                f"No picture of {self.width} x {self.height} pixels; each side has {shortest} to "
                f"{longest}."
            )


@dataclass(frozen=True)
class Frame:
    """One picture of an episode.

    Attributes:
        step: control steps since the beginning.
        episode_return: sum of the rewards so far.
        goal: what is left to do, in words: the target's distance and direction.
        picture: what the camera sees, nothing written in.
    """

    step: int
    episode_return: float
    goal: str
    picture: Picture

    @property
    def time(self) -> float:
        """Seconds since the beginning."""
        return self.step * CONTROL_TIMESTEP


def render_episode(
    policy: ActingPolicy,
    scene: Scene,
    at: Collection[int],
    progress: Callable[[int], object] = lambda steps: None,
) -> Iterator[Frame]:
    """Plays an episode and yields a picture at some of its control steps, in their order.

    Args:
        policy: for plain observations of the task.
        scene: which episode, and how to look at it.
        at: control steps, from 0 (before the first) on; the episode ends at the last of them.
        progress: told the number of control steps done.
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
    """Returns the control steps of a video's frames and the seconds between its frames.

    Frames are whole control steps apart, so that the speed is exact: in real time, 30 frames a
    second become 33.3.

    Args:
        frames_per_second: about so many.
        speed: 1 for real time, 0.5 for slow motion at half speed.
        steps: control steps to show.

    Raises:
        RequestError: if there is no such speed, or there are more frames than control steps, or
            no steps.
    """
    if not _SPEEDS[0] <= speed <= _SPEEDS[1]:
        raise RequestError(f"No speed {speed:g}; there are {_SPEEDS[0]:g} to {_SPEEDS[1]:g}.")
    _check_steps(steps)
    most = speed / CONTROL_TIMESTEP
    if not 1 <= frames_per_second <= most:
        raise RequestError(
            f"No video of {frames_per_second:g} frames a second; there are 1 to {most:g}."
        )
    stride = round(most / frames_per_second)
    return range(0, steps + 1, stride), stride * CONTROL_TIMESTEP / speed


def strip_steps(moments: int, steps: int = EPISODE_STEPS) -> Collection[int]:
    """Returns the control steps of so many moments, from the first to the last.

    Raises:
        RequestError: if that is less than two moments, or more than there are steps.
    """
    _check_steps(steps)
    if not 2 <= moments <= steps + 1:
        raise RequestError(f"No strip of {moments} moments in {steps} control steps.")
    return [round(moment * steps / (moments - 1)) for moment in range(moments)]


def _check_steps(steps: int) -> None:
    if not 1 <= steps <= EPISODE_STEPS:
        raise RequestError(f"An episode has 1 to {EPISODE_STEPS} control steps, not {steps}.")


def goal(task: str, observation: NDArray[np.floating]) -> str:
    """Returns in words what an observation (dim(O),) says is left to do.

    Distances are horizontal, and numbers are padded with spaces of a digit's width, so that a
    video's text stands still.
    """
    physical = features.denormalize(task, np.asarray(observation, np.float64))
    names = features.TASK_SPECS[task].features
    ends = np.cumsum([features.FEATURE_SIZES[name] for name in names])
    seen = dict(zip(names, np.split(physical, ends[:-1]), strict=True))
    if task == "move_from_origin":
        return f"{_centimetres(seen['position'])} from the origin"
    if task == "move_in_direction":
        speed = 100 * seen["speed_in_target_frame"][0]
        return f"{_padded(f'{speed:.1f}', 5)} cm/s as the target points"
    words = []
    if "target_in_jitterbug_frame" in seen:
        words.append(f"target {_centimetres(seen['target_in_jitterbug_frame'])} away")
    if "angle_to_target" in seen:
        angle = math.degrees(seen["angle_to_target"][0])
        side = "left" if angle > 0 else "right"
        words.append(f"turn {_padded(f'{abs(angle):.0f}', 3)}° {side}")
    return ", ".join(words)


def _centimetres(vector: NDArray[np.float64]) -> str:
    """Returns the horizontal length of a vector (3 or more,) in metres."""
    return f"{_padded(f'{100 * math.hypot(vector[0], vector[1]):.1f}', 4)} cm"


def _padded(number: str, width: int) -> str:
    return number.rjust(width, "\N{FIGURE SPACE}")
