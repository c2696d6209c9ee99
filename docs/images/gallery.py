"""Draws the gallery: python docs/images/gallery.py, headless or on a desktop, takes minutes.

Each animation shows the first seconds of an episode; its caption in the README has the return of
the whole episode, which this prints.
"""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jbench.opengl import choose_backend

if TYPE_CHECKING:
    from jbench.policies.find import ActingPolicy

HERE = Path(__file__).parent


class Clip(NamedTuple):
    """An animation.

    Attributes:
        policy: a shipped one; the hand-written one of tasks for which none is shipped.
        seed: of the episode, whose return is near the median of the policy.
        steps: control steps to show.
    """

    task: str
    policy: str
    name: str
    seed: int
    steps: int

    @property
    def path(self) -> Path:
        """The file of the animation."""
        return HERE / f"gallery-{self.task}.gif"


GALLERY = (
    Clip("move_from_origin", "heuristic", "hand-written", 0, 250),
    Clip(
        "face_direction",
        "reference/face_direction/td3/planar12/s06-690af48a",
        "TD3 on planar",
        0,
        250,
    ),
    Clip(
        "move_in_direction",
        "reference/move_in_direction/td3/planar12/s06-cc9bd006",
        "TD3 on planar",
        6,
        250,
    ),
    Clip("move_to_position", "heuristic", "hand-written", 7, 250),
    Clip("move_to_pose", "heuristic", "hand-written", 3, 400),
)


def whole_return(clip: Clip) -> float:
    """Returns the return of the whole episode."""
    from jbench.task_specs import EPISODE_STEPS
    from jbench.tasks.gym import RobotEnv

    env, policy = RobotEnv(clip.task), _policy(clip)
    (observation, _), total = env.reset(seed=clip.seed), 0.0
    policy.reset(1)
    for _ in range(EPISODE_STEPS):
        action = np.asarray(policy.act(observation[None])[0], np.float32)
        observation, reward, *_ = env.step(action)
        total += reward
    return total


def draw(clip: Clip) -> None:
    """Draws an animation at half of real time."""
    from jbench.rendering.episode import Scene
    from jbench.rendering.write import render_to_file

    scene = Scene(clip.task, seed=clip.seed, camera="spectator", width=480, height=360)
    render_to_file(_policy(clip), scene, clip.path, name=clip.name, speed=0.5, steps=clip.steps)


def _policy(clip: Clip) -> "ActingPolicy":
    from jbench.policies.find import find_policy
    from jbench.store.shipped import shipped_results

    return find_policy(shipped_results(), clip.policy, clip.task)


if __name__ == "__main__":
    choose_backend()
    for clip in GALLERY:
        draw(clip)
        kilobytes = clip.path.stat().st_size // 1000
        print(f"{clip.task}, {clip.name}: return {whole_return(clip):.0f}; {kilobytes} kB")
