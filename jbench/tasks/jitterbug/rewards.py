"""Rewards of the five tasks, as pure functions on batches of robots, like their observations.

The formulas are those of the paper (section 4.2) in dm_control's reward conventions
(arXiv:1801.00690, section 2).
"""

import math
from collections.abc import Callable

from array_api_compat import array_namespace

from jbench.task_specs import TASK_SPECS
from jbench.tasks.jitterbug import geometry
from jbench.tasks.jitterbug.geometry import Array, State, Target

# A Gaussian that decays to 0.1 at the margin: exp(-(_GAUSSIAN_SCALE * distance / margin)^2 / 2).
_GAUSSIAN_SCALE = math.sqrt(-2 * math.log(0.1))
_UPRIGHT_MARGIN = 0.5  # of the cosine of the torso's tilt
_NEAR_MARGIN = 0.05  # m
_FULL_SPEED = 0.1  # m/s


def upright_reward(state: State) -> Array:
    """Returns a Gaussian tolerance of the cosine of the torso's tilt; 1 if upright."""
    x, y = state.position[..., 4], state.position[..., 5]
    return _gaussian(2 * (x * x + y * y), _UPRIGHT_MARGIN)


def near_reward(state: State, target: Target) -> Array:
    """Returns a Gaussian tolerance of the 3D distance to the target; 0.1 at 5 cm."""
    return _gaussian(geometry.distance_to_target(state, target), _NEAR_MARGIN)


def heading_reward(state: State, target: Target, angle: Array | None = None) -> Array:
    """Returns (1 + cos 2a) / 2 for an angle to the target |a| < pi / 2, otherwise 0."""
    xp = array_namespace(state.position)
    angle = geometry.angle_to_target(state, target) if angle is None else angle
    facing = (1 + xp.cos(2 * angle)) / 2
    return xp.where(xp.abs(angle) < math.pi / 2, facing, xp.zeros_like(facing))


def speed_reward(state: State, target: Target) -> Array:
    """Returns the speed along the target's x axis divided by 0.1 m/s, clipped to [0, 1]."""
    return (geometry.speed_in_target_frame(state, target)[..., 0] / _FULL_SPEED).clip(0, 1)


_REWARDS: dict[str, Callable[[State, Target, Array | None], Array]] = {
    "away": lambda state, target, _: 1 - near_reward(state, target),
    "upright": lambda state, *_: upright_reward(state),
    "near": lambda state, target, _: near_reward(state, target),
    "heading": heading_reward,
    "speed": lambda state, target, _: speed_reward(state, target),
}


def reward(task: str, state: State, target: Target) -> Array:
    """Returns the reward (...) of a task, in [0, 1]; the target's axes broadcast."""
    return math.prod(reward_terms(task, state, target).values())


def reward_terms(
    task: str, state: State, target: Target, angle: Array | None = None
) -> dict[str, Array]:
    """Returns the terms (...), each in [0, 1], whose product is the reward; `angle` saves time."""
    names = TASK_SPECS[task].rewards
    return {name: _REWARDS[name](state, target, angle) for name in names}


def _gaussian(distance: Array, margin: float) -> Array:
    xp = array_namespace(distance)
    scaled = distance * (_GAUSSIAN_SCALE / margin)
    return xp.exp(-0.5 * scaled * scaled)
