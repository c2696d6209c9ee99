"""Rewards of the five tasks, as pure functions on batches of robots, like their observations.

The formulas are those of the paper (section 4.2) in dm_control's reward conventions
(arXiv:1801.00690, section 2).
"""

import math
from collections.abc import Callable, Mapping

from jbench.arrays import Array, namespace
from jbench.task_specs import TASK_SPECS
from jbench.tasks.jitterbug import geometry
from jbench.tasks.jitterbug.geometry import State, Target

# A Gaussian that decays to 0.1 at the margin: exp(-(_GAUSSIAN_SCALE * distance / margin)^2 / 2).
_GAUSSIAN_SCALE = math.sqrt(-2 * math.log(0.1))
_UPRIGHT_MARGIN = 0.5  # of the cosine of the torso's tilt
_NEAR_MARGIN = 0.05  # m
_FULL_SPEED = 0.1  # m/s

Features = Mapping[str, Array]
"""Features of an observation by name."""

_NONE_KNOWN: Features = {}


def upright_reward(state: State) -> Array:
    """Returns a Gaussian tolerance of the cosine of the torso's tilt; 1 if upright."""
    x = state.position[..., 4]
    y = state.position[..., 5]
    return _gaussian(2 * (x * x + y * y), _UPRIGHT_MARGIN)


def near_reward(state: State, target: Target) -> Array:
    """Returns a Gaussian tolerance of the 3D distance to the target; 0.1 at 5 cm."""
    return _gaussian(geometry.distance_to_target(state, target), _NEAR_MARGIN)


def heading_reward(angle: Array) -> Array:
    """Returns (1 + cos 2a) / 2 for an angle to the target |a| < pi / 2, otherwise 0."""
    xp = namespace(angle)
    facing = (1 + xp.cos(2 * angle)) / 2
    return xp.where(xp.abs(angle) < math.pi / 2, facing, 0.0)


def speed_reward(speed: Array) -> Array:
    """Returns a speed along the target's x axis divided by 0.1 m/s, clipped to [0, 1]."""
    return (speed / _FULL_SPEED).clip(0, 1)


def _upright(state: State, target: Target, known: Features) -> Array:
    """Returns the term (...) of a robot that stands."""
    return upright_reward(state)


def _near(state: State, target: Target, known: Features) -> Array:
    """Returns the term (...) of a robot at its target."""
    return near_reward(state, target)


def _away(state: State, target: Target, known: Features) -> Array:
    """Returns the term (...) of a robot far from its target."""
    return 1 - near_reward(state, target)


def _heading(state: State, target: Target, known: Features) -> Array:
    """Returns the term (...) of a robot that faces as its target does."""
    if "angle_to_target" in known:
        return heading_reward(known["angle_to_target"][..., 0])
    return heading_reward(geometry.angle_to_target(state, target))


def _speed(state: State, target: Target, known: Features) -> Array:
    """Returns the term (...) of a robot that moves as its target points."""
    if "speed_in_target_frame" in known:
        return speed_reward(known["speed_in_target_frame"][..., 0])
    return speed_reward(geometry.speed_in_target_frame(state, target)[..., 0])


_REWARDS: dict[str, Callable[[State, Target, Features], Array]] = {
    "away": _away,
    "upright": _upright,
    "near": _near,
    "heading": _heading,
    "speed": _speed,
}


def reward(task: str, state: State, target: Target, known: Features = _NONE_KNOWN) -> Array:
    """Returns the reward (...) of a task, in [0, 1]; the target's axes broadcast."""
    return math.prod(reward_terms(task, state, target, known).values())


def reward_terms(
    task: str, state: State, target: Target, known: Features = _NONE_KNOWN
) -> dict[str, Array]:
    """Returns the terms (...), each in [0, 1], whose product is the reward.

    Args:
        task: one of the five tasks.
        state: of robots.
        target: of theirs; its axes broadcast.
        known: features of this state that are computed already, each (..., size) in SI units.
    """
    names = TASK_SPECS[task].rewards
    return {name: _REWARDS[name](state, target, known) for name in names}


def _gaussian(distance: Array, margin: float) -> Array:
    """Returns dm_control's tolerance: 1 at 0, and 0.1 at the margin."""
    xp = namespace(distance)
    scaled = distance * (_GAUSSIAN_SCALE / margin)
    return xp.exp(-0.5 * scaled * scaled)
