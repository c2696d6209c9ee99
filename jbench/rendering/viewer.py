"""An interactive viewer of a policy, in which the mouse can pull the robot."""

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from jbench.errors import RequestError
from jbench.opengl import open_display
from jbench.policies.find import ActingPolicy
from jbench.rendering.episode import Scene
from jbench.tasks.find import find_task
from jbench.tasks.gym import RobotEnv

# Initial camera position relative to the robot.
_DISTANCE = 2.25  # extents of the model; of the Jitterbug 0.45 m
_AZIMUTH = 120.0
_ELEVATION = -25.0  # degrees


def view(policy: ActingPolicy, scene: Scene) -> int:
    """Opens MuJoCo's viewer and simulates episodes in real time until the window is closed.

    The scene is that of the first episode; its camera and size are ignored. Returns the number of
    simulated control steps. Raises a RequestError if no window can be opened here, or the task has
    another model in each episode, or none.
    """
    task = find_task(scene.task)
    if not task.has_physics:
        raise RequestError(
            f"{scene.task} has no MuJoCo physics, which a window shows; type jbench render."
        )
    if not task.has_one_model:
        raise RequestError(
            f"{scene.task} is made again for each episode, and a window shows one model; give its "
            "task a RandomState `random`, or type jbench render."
        )

    steps = begun = 0
    with contextlib.closing(scene.environment(render_mode=None)) as env:
        observation, _ = env.reset(seed=scene.seed)
        policy.reset(1)
        with _window(env) as window:
            due = time.perf_counter()
            while window.is_running():
                action = np.asarray(policy.act(observation[None])[0], np.float32)
                # The window's thread reads the state, and changes it when the mouse pulls.
                with window.lock():
                    observation, _, terminated, truncated, _ = env.step(action)
                    steps += 1
                    if terminated or truncated or steps - begun == task.episode_steps:
                        begun = steps
                        observation, _ = env.reset()
                        policy.reset(1)

                window.sync()
                due += scene.timestep
                late = time.perf_counter() - due
                # A slow machine runs slower than real time and does not catch up.
                due += max(late, 0)
                time.sleep(max(-late, 0))

    return steps


@contextlib.contextmanager
def _window(env: RobotEnv) -> Iterator[Any]:
    """Yields MuJoCo's viewer, closes it, and waits for the threads that draw.

    The process would crash if it exited, or freed the robot, before they end.
    """
    others = set(threading.enumerate())
    try:
        with _open_window(env) as window:
            yield window
    finally:
        for thread in set(threading.enumerate()) - others:
            thread.join(30)  # s


def _open_window(env: RobotEnv) -> Any:
    """Opens MuJoCo's viewer, or raises a RequestError without a display."""
    # An error would end the viewer's thread, for which the viewer would wait forever.
    if not open_display():
        raise RequestError("The display can't be opened; jbench render draws without one.")

    # Deferred, since it looks for a window system.
    import mujoco.viewer

    try:
        window = mujoco.viewer.launch_passive(env.model, env.data, show_right_ui=False)
    except RuntimeError as error:
        raise RequestError(f"No window can be opened here: {str(error).rstrip('.')}.") from None

    with window.lock():
        window.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        window.cam.trackbodyid = 1  # the first body of the world
        window.cam.distance = _DISTANCE * env.model.stat.extent
        window.cam.azimuth = _AZIMUTH
        window.cam.elevation = _ELEVATION

    return window
