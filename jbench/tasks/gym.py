"""The five tasks as Gymnasium environments.

gymnasium.make("jbench:Jitterbug/FaceDirection-v0")
gymnasium.make("jbench:AugmentedJitterbug/FaceDirection-v0", augment=3)
"""

import math
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.task_specs import CAMERAS, CONTROL_TIMESTEP, PHYSICS_STEPS, TASK_SPECS
from jbench.tasks.dm_gym import SuiteEnv
from jbench.tasks.jitterbug import features, model, resets, rewards
from jbench.tasks.jitterbug.geometry import Array, State, Target, distance_to_target
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.pictures import Artist


class JitterbugEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One task of the Jitterbug problem (paper, section 4.2).

    Observations are the task's features, each mapped from its range to [-1, 1] and not clipped.
    The action is the motor's command, clipped to [-1, 1]. Episodes never terminate;
    `gymnasium.make` truncates them at 1000 steps. `outcome` lists what `info` contains; at reset,
    its reward terms are those of the initial state. `model` has the robot and its target, `data`
    its state.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared as in Gymnasium
        "render_modes": ["rgb_array", "human"],
        "render_fps": round(1 / CONTROL_TIMESTEP),
    }

    def __init__(
        self,
        task: str,
        render_mode: str | None = None,
        camera: str = "tracking",
        width: int = 640,
        height: int = 480,
        augment: int | None = None,
        vary_masses: bool = False,
    ) -> None:
        """Initializes the environment.

        Args:
            task: one of `jbench.names.TASKS`.
            render_mode: "rgb_array", "human", or None for no rendering.
            camera: one of `CAMERAS`.
            width, height: of a picture, in pixels, at least 1.
            augment: seed of an augmented robot's morphology, or None for the plain robot.
            vary_masses: whether to vary the augmented robot's densities and gear as well.

        Raises:
            ValueError: if an argument is none of these.
        """
        modes = None, *self.metadata["render_modes"]
        for value, known in ((task, TASKS), (camera, CAMERAS), (render_mode, modes)):
            if value not in known:
                raise ValueError(f"{value!r} is not one of {', '.join(map(str, known))}")

        if not all(isinstance(side, int | np.integer) and side > 0 for side in (width, height)):
            raise RequestError(
                "width and height must be whole numbers of pixels of at least 1, not "
                f"{width!r} and {height!r}."
            )

        self.task = task
        self.render_mode = render_mode
        size = features.observation_size(task)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)
        self._camera = camera
        self._size = (width, height)
        self._artist: Artist | None = None
        self.model = load_model(augment, vary_masses=vary_masses)
        # Pixels outside the offscreen buffer would be black.
        buffer = self.model.vis.global_
        buffer.offwidth = max(buffer.offwidth, width)
        buffer.offheight = max(buffer.offheight, height)
        self.data = mujoco.MjData(self.model)
        self._torso_offset = model.torso_offset(self.model)
        self._target = resets.draw_target(task, np.random.default_rng(0))

    @property
    def state(self) -> State:
        """The state of the robot, without leading axes."""
        return model.read_state(self.data.qpos, self.data.qvel, self._torso_offset)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode with a random orientation at the origin and a random target.

        The options {"target": numbers} choose the target, see `resets.target_numbers`; the other
        random numbers, of this episode and the next ones, stay the same.

        Raises:
            RequestError: if an option does not exist or its value is wrong; a ValueError.
        """
        chosen = resets.option_target(self.task, options)
        super().reset(seed=seed)
        model.place(self.data, resets.draw_quaternion(self.np_random))
        drawn = resets.draw_target(self.task, self.np_random)
        self._target = drawn if chosen is None else chosen
        self.show_target(self._target)
        if self.render_mode == "human":
            self.render()

        observation, _, info = self._outcome()
        return observation, info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Applies the action (1,) for one control step of 0.01 s; a wrong one is a ValueError."""
        try:
            self.data.ctrl[:] = np.clip(action, -1, 1)
        except (TypeError, ValueError):
            raise RequestError(
                f"The action must be a number, of shape (1,), not {action!r}."
            ) from None

        mujoco.mj_step(self.model, self.data, nstep=PHYSICS_STEPS)
        observation, reward, info = self._outcome()
        if self.render_mode == "human":
            self.render()

        return observation, reward, False, False, info

    def show_target(self, target: Target) -> None:
        """Moves the target that is drawn, which has no influence on the robot."""
        self.model.body("target").pos = target.position
        self.model.body("target").quat = model.yaw_quaternion(target.yaw)

    def render(self) -> Any:
        """Returns an image (height, width, 3) in mode "rgb_array"; otherwise None.

        Raises:
            RequestError: if MUJOCO_GL names no backend and none works, or if there is no display
                for "human"; a ValueError.
        """
        if self.render_mode is None:
            return None
        if self._artist is None:
            camera = self.model.camera(self._camera).id
            self._artist = Artist(self.model, self.data, camera, *self._size)
        return self._artist.draw(self.render_mode)

    def __getstate__(self) -> dict[str, Any]:
        """Returns what is copied: all but what draws, which the copy makes again."""
        return {**vars(self), "_artist": None}

    def close(self) -> None:
        """Closes windows and frees the renderer."""
        if self._artist is not None:
            self._artist.close()
            self._artist = None

    def _outcome(self) -> tuple[NDArray[np.float32], float, dict[str, Any]]:
        """Returns the observation, the reward and the info of the present state."""
        observation, reward, info = outcome(self.task, self.state, self._target)
        numbers = {key: value if key == "target" else float(value) for key, value in info.items()}
        return observation, float(reward), numbers


def outcome(
    task: str, state: State, target: Target
) -> tuple[NDArray[np.float32], Array, dict[str, Array]]:
    """Returns observation, reward and `info` of states of a task, with any leading axes `...`.

    Returns:
        The observation (..., dim(O)), the reward (...), and by name
            target: (..., n) the target's random numbers, see `resets.target_numbers`,
            distance: (...) from the torso to the target (m), if the reward depends on it,
            angle: (...) from heading to target in (-pi, pi] (rad), if the task observes it,
            reward_...: (...) each term of the reward, which is their product.
    """
    values = features.features(task, state, target)
    info = {}
    if TASK_SPECS[task].drawn:
        info["target"] = resets.target_numbers(task, target)
    if not {"near", "away"}.isdisjoint(TASK_SPECS[task].rewards):
        info["distance"] = distance_to_target(state, target)
    if "angle_to_target" in values:
        info["angle"] = values["angle_to_target"][..., 0]
    terms = rewards.reward_terms(task, state, target, values)
    info.update({f"reward_{name}": term for name, term in terms.items()})
    observation = np.asarray(features.flatten(task, values), np.float32)
    return observation, math.prod(terms.values()), info


def make_environment(
    task: str,
    render_mode: str | None,
    camera: str | None,
    width: int,
    height: int,
    augment: int | None = None,
) -> JitterbugEnv | SuiteEnv:
    """Returns an environment of any task, without a time limit of Gymnasium's.

    Raises a RequestError if the robot has no such camera or, of another package, no physics.
    """
    if task not in TASKS:
        return SuiteEnv(task, render_mode, camera, width, height, augment)
    filmed_by = camera or "tracking"
    return JitterbugEnv(task, render_mode, filmed_by, width, height, augment)
