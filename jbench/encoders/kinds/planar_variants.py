"""Variants of `planar`: without the yaw rate, with all that it leaves out, or mirrored."""

from array_api_compat import array_namespace

from jbench.encoders.kind import Weights
from jbench.encoders.kinds import planar
from jbench.encoders.kinds.planar import SIGNS, Numbers, PlanarReduction
from jbench.tasks.features import split
from jbench.tasks.geometry import Array


class PlanarWithoutYawRate(PlanarReduction):
    """`planar` without the yaw rate, to see what an agent loses that does not observe it."""

    def numbers(self, task: str, physical: Array) -> Numbers:
        """Returns those of `planar` but the yaw rate, which is 0 in what is decoded."""
        numbers = super().numbers(task, physical)
        del numbers["rate_z"]
        return numbers


class HeadingFrame(PlanarReduction):
    """The numbers of `planar` and those that it leaves out: the control for its coordinates.

    Nothing but the sign of the quaternion, which has no physical meaning, is left out.
    """

    def numbers(self, task: str, physical: Array) -> Numbers:
        """Returns planar numbers, x, y (m), cosine and sine of the heading h, and speed (m/s)."""
        by_name = split(task, physical)
        position = by_name["position"]
        _, _, _, cosine, sine = planar.swing_and_twist(position[..., 3:])
        turn = {"x": position[..., 0], "y": position[..., 1], "cosine": cosine, "sine": sine}
        if "speed_in_target_frame" in by_name:
            speed = by_name["speed_in_target_frame"]
            turn |= planar.by_axis("speed", [speed[..., axis] for axis in range(3)])
        return super().numbers(task, physical) | turn


class PlanarMirror(PlanarReduction):
    """The planar reduction, folded by the robot's mirror symmetry (`jbench/tasks/features.py`).

    Where the target is on the robot's right, the latents are those of the mirrored robot, whose
    target is on its left, and the robot gets the negated action of the policy. So the agent sees
    only half of the states, and each of its transitions stands for two.

    The side is the sign of the angle to the target. A task without it has the sign of the lateral
    component of the way to the target or, in `move_from_origin`, to the origin.
    """

    def numbers(self, task: str, physical: Array) -> Numbers:
        where = array_namespace(physical).where
        numbers = super().numbers(task, physical)
        is_right = _side(numbers) < 0
        return {n: where(is_right, SIGNS[n] * value, value) for n, value in numbers.items()}

    def action_signs(self, weights: Weights, scaled: Array) -> Array:
        task, physical = planar.task_and_features(weights, scaled)
        # An observed angle is a feature, without the rotations that take most of the time.
        angle = split(task, physical).get("angle_to_target")
        side = _side(super().numbers(task, physical))[..., None] if angle is None else angle
        xp = array_namespace(scaled)
        sign = xp.asarray([1], dtype=scaled.dtype, device=getattr(scaled, "device", None))
        return xp.where(side < 0, -sign, sign)


def _side(numbers: Numbers) -> Array:
    """Returns what is negative if the target is on the right."""
    return numbers["angle"] if "angle" in numbers else numbers["target_x"]
