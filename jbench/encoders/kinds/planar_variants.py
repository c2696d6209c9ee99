"""Variants of `planar`: without the yaw rate, with all that it leaves out, or mirrored."""

from array_api_compat import array_namespace

from jbench.encoders.kind import Weights
from jbench.encoders.kinds.planar import (
    SIGNS,
    Numbers,
    PlanarReduction,
    rotated_in_plane,
    swing_and_twist,
    task_and_features,
)
from jbench.task_specs import TASK_SPECS
from jbench.tasks.features import split
from jbench.tasks.geometry import Array, State, Target, center_of_mass_velocity


class PlanarWithoutYawRate(PlanarReduction):
    """`planar` without the yaw rate, to see what an agent loses that does not observe it."""

    @classmethod
    def columns(cls, task: str) -> tuple[str, ...]:
        """Returns those of `planar` but the yaw rate, which is 0 in what is decoded."""
        return tuple(name for name in super().columns(task) if name != "rate_z")


class HeadingFrame(PlanarReduction):
    """The numbers of `planar` and those that it leaves out: the control for its coordinates.

    Nothing but the sign of the quaternion, which has no physical meaning, is left out.
    """

    @classmethod
    def columns(cls, task: str) -> tuple[str, ...]:
        """Returns those of `planar`, the robot's place and turn, and the speed that it observes."""
        observes_speed = "speed_in_target_frame" in TASK_SPECS[task].features
        speeds = ("speed_x", "speed_y", "speed_z") * observes_speed
        return *super().columns(task), "x", "y", "cosine", "sine", *speeds

    def numbers(self, task: str, physical: Array) -> Numbers:
        """Returns planar numbers, x, y (m), cosine and sine of the heading h, and speed (m/s)."""
        by_name = split(task, physical)
        position = by_name["position"]
        _, _, _, cosine, sine = swing_and_twist(position[..., 3:])
        turn = {"x": position[..., 0], "y": position[..., 1], "cosine": cosine, "sine": sine}
        speed = by_name.get("speed_in_target_frame")
        speeds = {} if speed is None else {f"speed_{x}": speed[..., i] for i, x in enumerate("xyz")}
        return super().numbers(task, physical) | turn | speeds

    def robot(self, task: str, numbers: Numbers, center_of_mass: Array) -> tuple[State, Target]:
        """Returns the robot of `planar`, turned by the heading and moved to its place."""
        state, target = super().robot(task, numbers, center_of_mass)
        cosine, sine = numbers["cosine"], numbers["sine"]
        xp = array_namespace(cosine)
        place = xp.stack([numbers["x"], numbers["y"]], axis=-1)
        length = xp.sqrt(xp.clip(cosine * cosine + sine * sine, 1e-12, None))
        return _moved(state, target, place, cosine / length, sine / length, center_of_mass)


def _moved(
    state: State, target: Target, place: Array, cosine: Array, sine: Array, center_of_mass: Array
) -> tuple[State, Target]:
    """Returns robot and target turned about the vertical, then shifted so that it is at `place`."""
    xp = array_namespace(place)

    def turned(vector: Array) -> Array:
        x, y = rotated_in_plane(cosine, sine, vector[..., 0], vector[..., 1])
        return xp.concat([xp.stack([x, y], axis=-1), vector[..., 2:]], axis=-1)

    # (cos(h/2), 0, 0, sin(h/2)) times the quaternion (c, a, b, 0) of the tilt.
    half_sine = xp.sqrt(xp.clip((1 - cosine) / 2, 0.0, None))
    half_sine = xp.where(sine < 0, -half_sine, half_sine)
    half_cosine = xp.sqrt(xp.clip((1 + cosine) / 2, 0.0, None))
    c, a, b = (state.position[..., i] for i in (3, 4, 5))
    quaternion = [
        *(half_cosine * c, half_cosine * a - half_sine * b),
        *(half_cosine * b + half_sine * a, half_sine * c),
    ]
    shift = place - turned(state.position[..., :3])[..., :2]
    position = xp.concat([place, state.position[..., 2:3], xp.stack(quaternion, axis=-1)], axis=-1)
    velocity = turned(state.velocity)
    goal = turned(target.position)
    return (
        state._replace(
            position=position,
            velocity=velocity,
            torso_velocity=center_of_mass_velocity(position, velocity, center_of_mass),
        ),
        Target(
            xp.concat([goal[..., :2] + shift, goal[..., 2:]], axis=-1),
            target.yaw + xp.atan2(sine, cosine),
        ),
    )


class PlanarMirror(PlanarReduction):
    """The planar reduction, folded by the robot's mirror symmetry (`jbench/tasks/features.py`).

    Where the target is on the robot's right, the latents are those of the mirrored robot, whose
    target is on its left, and the robot gets the negated action of the policy. So the agent sees
    only half of the states, and each of its transitions stands for two.

    The side is the sign of the angle to the target. A task without it has the sign of the lateral
    component of the way to the target or, in `move_from_origin`, to the origin.
    """

    def numbers(self, task: str, physical: Array) -> Numbers:
        """Returns the planar numbers of the robot, or of its mirror image."""
        where = array_namespace(physical).where
        planar = super().numbers(task, physical)
        is_right = _side(planar) < 0
        return {n: where(is_right, SIGNS[n] * value, value) for n, value in planar.items()}

    def action_signs(self, weights: Weights, scaled: Array) -> Array:
        """Returns (..., 1), -1 for states whose mirror image is encoded and 1 for the others."""
        task, physical = task_and_features(weights, scaled)
        # An observed angle is a feature, without the rotations that take most of the time.
        angle = split(task, physical).get("angle_to_target")
        side = _side(super().numbers(task, physical))[..., None] if angle is None else angle
        xp = array_namespace(scaled)
        one = xp.asarray([1], dtype=scaled.dtype, device=getattr(scaled, "device", None))
        return xp.where(side < 0, -one, one)


def _side(planar: Numbers) -> Array:
    """Returns what is negative if the target is on the right."""
    return planar["angle"] if "angle" in planar else planar["target_x"]
