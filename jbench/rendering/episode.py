"""Rendering an episode of a policy as images."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.names import CONTROL_TIMESTEP, TASKS
from jbench.policies.find import ActingPolicy
from jbench.simulation import find_task
from jbench.simulation.suite_env import SuiteEnv
from jbench.tasks.gym import JitterbugEnv
from jbench.tasks.labels import goal

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
