"""Rendering an episode of a policy as images."""

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.names import CONTROL_TIMESTEP, TASKS
from jbench.policies.find import ActingPolicy
from jbench.simulation import find_task
from jbench.simulation.suite_env import SuiteEnv
from jbench.tasks import features
from jbench.tasks.gym import JitterbugEnv

Picture = NDArray[np.uint8]
"""(height, width, 3), red, green and blue in [0, 255]."""

# Fewer than the model's default: without a GPU an image takes half the time and looks the same.
# With 4096, dots appear in the corners of the overhead view.
_SHADOW_TEXELS = 5120


@dataclass(frozen=True)
class Scene:
    """An episode and a camera.

    Attributes:
        seed: of the initial pose and the target.
        camera: one of the robot's model; None for `tracking`, or another robot's first.
        width, height: in pixels.
        augment: seed of an augmented robot's morphology, or None for the plain robot.
    """

    task: str
    seed: int = 0
    camera: str | None = None
    width: int = 640
    height: int = 480
    augment: int | None = None

    @property
    def timestep(self) -> float:
        """Simulated seconds in a control step."""
        return find_task(self.task).control_timestep or CONTROL_TIMESTEP

    def environment(self, render_mode: str | None = "rgb_array") -> JitterbugEnv | SuiteEnv:
        """Returns an environment.

        Args:
            render_mode: "rgb_array" to draw pictures, or None.

        Raises:
            RequestError: if the robot has no such camera or, of another package, no physics.
        """
        size = self.width, self.height
        if self.task not in TASKS:
            return SuiteEnv(self.task, render_mode, self.camera, *size, self.augment)
        env = JitterbugEnv(self.task, render_mode, self.camera or "tracking", *size, self.augment)
        env.model.vis.quality.shadowsize = _SHADOW_TEXELS
        return env


@dataclass(frozen=True)
class Frame:
    """One image of an episode.

    Attributes:
        step: control steps since the start.
        episode_return: sum of the rewards so far.
        goal: distance and direction of the target as text; empty for other robots.
        picture: image without text.
        timestep: simulated seconds in a control step.
    """

    step: int
    episode_return: float
    goal: str
    picture: Picture
    timestep: float = CONTROL_TIMESTEP

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.step * self.timestep


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
    env = scene.environment()
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
                words = goal(scene.task, observation) if scene.task in TASKS else ""
                picture = np.asarray(env.render())
                yield Frame(step, episode_return, words, picture, scene.timestep)
            progress(step)
    finally:
        env.close()


def goal(task: str, observation: NDArray[np.floating]) -> str:
    """Describes the remaining distance and angle to the goal of an observation (dim(O),).

    Distances are horizontal. Numbers are padded with figure spaces to a fixed width.
    """
    physical = features.denormalize(task, np.asarray(observation, np.float64))
    by_name = features.split(task, physical)
    if task == "move_from_origin":
        return f"{_centimeters(by_name['position'])} from the origin"
    if task == "move_in_direction":
        speed = 100 * by_name["speed_in_target_frame"][0]
        return f"{padded(f'{speed:.1f}', 5)} cm/s as the target points"
    words = []
    if "target_in_jitterbug_frame" in by_name:
        words.append(f"target {_centimeters(by_name['target_in_jitterbug_frame'])} away")
    if "angle_to_target" in by_name:
        angle = math.degrees(by_name["angle_to_target"][0])
        side = "left" if angle > 0 else "right"
        words.append(f"turn {padded(f'{abs(angle):.0f}', 3)}° {side}")
    return ", ".join(words)


def _centimeters(vector: NDArray[np.float64]) -> str:
    """Returns the horizontal length of a vector (3 or more,) in meters."""
    return f"{padded(f'{100 * math.hypot(vector[0], vector[1]):.1f}', 4)} cm"


def padded(number: str, width: int) -> str:
    """Returns a number with figure spaces before it, which are as wide as digits."""
    return number.rjust(width, "\N{FIGURE SPACE}")
