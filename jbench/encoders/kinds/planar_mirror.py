"""The planar reduction, folded by the robot's mirror symmetry (`jbench/tasks/mirror.py`).

Where the target is on the robot's right, the latents are those of the mirrored robot, whose target
is on its left, and the robot gets the negated action of the policy. So the agent sees only half of
the states, and each of its transitions stands for two.

The side is the sign of the angle to the target. A task without it has the sign of the lateral
component of the way to the target or, in `move_from_origin`, to the origin, in the heading frame.
"""

from array_api_compat import array_namespace

from jbench.encoders.kind import Weights
from jbench.encoders.kinds.planar import PlanarReduction, task_and_features, to_planar
from jbench.tasks.features import TASK_SPECS, Array, split

# Signs of the mirrored planar numbers, in their order.
_ROBOT = (1, 1, -1, -1, 1, 1, 1, -1, -1, -1, -1)
_WAY = (-1, 1)
_ANGLE = (-1,)


class PlanarMirror(PlanarReduction):
    """The observation modulo planar motions and reflection; it has no options.

    The angle to the target, or the lateral way to it, is never negative before its scaling.
    """

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the planar numbers of the robot, or of its mirror image."""
        xp = array_namespace(physical)
        planar = to_planar(task, physical)
        mirrored = planar * _constant(planar_signs(task), physical)
        return xp.where(planar[..., _side(task)] < 0, mirrored, planar)

    def action_signs(self, weights: Weights, scaled: Array) -> Array:
        """Returns (..., 1), -1 for states whose mirror image is encoded and 1 for the others."""
        xp = array_namespace(scaled)
        task, physical = task_and_features(weights, scaled)
        # An observed angle is a feature, without the rotations that take most of the time.
        side = split(task, physical).get("angle_to_target")
        if side is None:
            side = to_planar(task, physical)[..., _side(task)]
        minus = _constant((-1,), scaled)
        return xp.where(side < 0, minus, -minus)


def planar_signs(task: str) -> tuple[int, ...]:
    """Returns factors 1 or -1 that mirror the planar numbers of a task."""
    spec = TASK_SPECS[task]
    return _ROBOT + _WAY * spec.rewards_position + _ANGLE * ("angle_to_target" in spec.features)


def _side(task: str) -> slice:
    """Returns the column of the planar numbers that is negative if the target is on the right."""
    has_angle = "angle_to_target" in TASK_SPECS[task].features
    column = len(planar_signs(task)) - 1 if has_angle else len(_ROBOT)
    return slice(column, column + 1)


def _constant(values: tuple[int, ...], like: Array) -> Array:
    xp = array_namespace(like)
    return xp.asarray(values, dtype=like.dtype, device=getattr(like, "device", None))
