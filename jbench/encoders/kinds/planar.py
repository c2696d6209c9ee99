"""The reduction of an observation by translation and rotation in the plane.

Rewards and dynamics do not change when robot and target are translated on the floor or rotated
about the vertical together. An observation modulo this symmetry determines the rewards and the
changes of the state with fewer numbers.

The symmetry is exact except for the friction cone: MuJoCo's default is a pyramid along the world
axes, so the simulated robot is symmetric under translations and quarter turns to rounding, and
under other rotations only with an elliptic cone. The reduction loses only the direction of the
pyramid.

The latents are the `SIGNS` of a task, in this order, in the heading frame: the world rotated about
the vertical by the heading h. `swing_and_twist` splits the orientation into h and a tilt.
`move_from_origin` has no target, but its reward depends on the distance from the origin, which
takes the target's place: only rotations about the origin are symmetries of this task.
"""

import functools
import itertools
from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from jbench.array_types import FloatArray
from jbench.arrays import Array, namespace
from jbench.encoders.kind import Fitted
from jbench.encoders.networks import Weights
from jbench.encoders.scaling import Scaling, physical_scaling
from jbench.encoders.states import States
from jbench.task_specs import TASK_SPECS
from jbench.tasks.find import find_task
from jbench.tasks.jitterbug import geometry, model
from jbench.tasks.jitterbug.features import features, observation_size, split
from jbench.tasks.jitterbug.geometry import State, Target
from jbench.tasks.jitterbug.robots import load_model

SIGNS = {
    "height": 1,  # m
    "tilt_a": 1,  # a and b of `swing_and_twist`, sin(angle / 2) of the tilt
    "tilt_b": -1,
    "velocity_x": -1,  # of the torso's frame (m/s)
    "velocity_y": 1,
    "velocity_z": 1,
    "rate_x": 1,  # angular velocity (rad/s)
    "rate_y": -1,
    "rate_z": -1,
    "motor_angle": -1,  # as observed (rad)
    "motor_speed": -1,  # as observed (rad/s)
    "target_x": -1,  # from the robot to its target (m), if the reward depends on the position
    "target_y": 1,
    "angle": -1,  # to the target, as observed (rad), if the task observes it
}
"""The planar numbers, each with the factor by which the robot's mirror image has it."""


class PlanarReduction(Fitted):
    """The observation modulo translation and rotation in the plane.

    Each latent is scaled to [-1, 1] by its extremes over the dataset, like the inputs of every
    kind. `heading` has the same numbers and those that `planar` leaves out, so agents on these two
    differ only in the reduction.
    """

    is_rowwise = True
    needs_all_features = True

    @classmethod
    def columns(cls, task: str) -> tuple[str, ...]:
        """Returns the names of the latents of a task, in order."""
        return tuple(cls().numbers(task, np.zeros(observation_size(task))))

    def latent_sizes(self, task: str, features: int) -> range:
        """The number of columns that the task has, and no other."""
        if not find_task(task).has_planar_reduction:
            return range(0)

        size = len(self.columns(task))
        return range(size, size + 1)

    def numbers(self, task: str, physical: Array) -> dict[str, Array]:
        """Returns the latents before scaling, for features (..., dim(O)) in SI units."""
        by_name = split(task, physical)
        position = by_name["position"]
        velocity = by_name["velocity"]
        length, a, b, cosine, sine = geometry.swing_and_twist(position[..., 3:])
        along, across = geometry.rotated_in_plane(cosine, -sine, velocity[..., 0], velocity[..., 1])
        numbers = {
            "height": position[..., 2],
            "tilt_a": a,
            "tilt_b": b,
            **_by_axis("velocity", [along, across, velocity[..., 2]]),
            **_by_axis("rate", geometry.tilted(length, a, b, velocity[..., 3:])),
            "motor_angle": by_name["motor_position"][..., 0],
            "motor_speed": by_name["motor_velocity"][..., 0],
        }
        if "target_in_jitterbug_frame" in by_name:
            way = geometry.tilted(length, a, b, by_name["target_in_jitterbug_frame"])
            numbers |= _by_axis("target", way[:2])
        elif "away" in TASK_SPECS[task].rewards:
            way = geometry.rotated_in_plane(cosine, -sine, -position[..., 0], -position[..., 1])
            numbers |= _by_axis("target", way)

        if "angle_to_target" in by_name:
            numbers["angle"] = by_name["angle_to_target"][..., 0]

        return numbers

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the `numbers` as an array (..., latents)."""
        numbers = self.numbers(task, physical)
        return namespace(physical).stack(list(numbers.values()), axis=-1)

    def restore(self, task: str, latents: Array, center_of_mass: Array) -> Array:
        """Returns features (..., dim(O)) in SI units of a robot with these unscaled latents.

        Missing ones are 0. Unless they say its place and turn (`HeadingFrame`), the robot's
        heading h is 0, and it is at the origin; in `move_from_origin` it is on the other side of
        the way to the origin. The torso's center of mass (3,) is in its own frame (m).
        """
        xp = namespace(latents)
        zero = xp.zeros_like(latents[..., 0])
        numbers = defaultdict[str, Array](lambda: zero)
        for i, name in enumerate(self.columns(task)):
            numbers[name] = latents[..., i]

        way = [numbers["target_x"], numbers["target_y"]]
        home = [-part for part in way]
        if "x" in TASK_SPECS[task].drawn:
            home = [zero, zero]

        place = [numbers.get(axis, part) for axis, part in zip("xy", home, strict=True)]

        cosine = numbers.get("cosine", zero + 1)
        sine = numbers["sine"]
        length = xp.sqrt(xp.clip(cosine * cosine + sine * sine, 1e-12, None))
        cosine = cosine / length
        sine = sine / length
        a = numbers["tilt_a"]
        b = numbers["tilt_b"]
        c = xp.sqrt(xp.clip(1 - a * a - b * b, 0.0, 1.0))
        tilt = xp.stack([zero, zero, zero, c, a, b, zero], axis=-1)

        # (cos(h/2), 0, 0, sin(h/2)) times the quaternion (c, a, b, 0) of the tilt.
        squares = (1 + cosine) / 2, (1 - cosine) / 2
        half, half_sine = (xp.sqrt(xp.clip(square, 0.0, None)) for square in squares)
        half_sine = xp.where(sine < 0, -half_sine, half_sine)
        quaternion = [half * c, half * a - half_sine * b, half * b + half_sine * a, half_sine * c]
        position = xp.stack([*place, numbers["height"], *quaternion], axis=-1)

        along, across, up = (numbers[f"velocity_{axis}"] for axis in "xyz")
        speeds = [*geometry.rotated_in_plane(cosine, sine, along, across), up]
        back = xp.matrix_transpose(geometry.rotation_matrix(tilt[..., 3:]))
        rates = xp.stack([numbers[f"rate_{axis}"] for axis in "xyz"], axis=-1)
        rates = geometry.rotate(back, rates)
        velocity = xp.concat([xp.stack(speeds, axis=-1), rates], axis=-1)
        torso_velocity = geometry.center_of_mass_velocity(position, velocity, center_of_mass)
        state = State(
            position, velocity, numbers["motor_angle"], numbers["motor_speed"], torso_velocity
        )

        turned = geometry.rotated_in_plane(cosine, sine, *way)
        target = [part + shift for part, shift in zip(turned, place, strict=True)]
        target = xp.stack([*target, zero + geometry.TARGET_HEIGHT], axis=-1)
        yaw = numbers["angle"] + geometry.heading(state._replace(position=tilt))
        aim = Target(target, yaw + xp.atan2(sine, cosine))
        return xp.concat(list(features(task, state, aim).values()), axis=-1)

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """The extremes of the reduced numbers, in learning and test episodes."""
        gain, offset = physical_scaling(states.task, states.scaling)
        shards = itertools.chain(states.learn(), states.test())
        seen = (shard.states.cpu().double().numpy() * gain + offset for shard in shards)
        numbers = (self.reduce(states.task, physical) for physical in seen)
        extremes = functools.reduce(Scaling.merged, map(Scaling.of, numbers))
        robot = load_model(states.dataset.settings.augment)
        return planar_weights(states.task, states.scaling, extremes, model.torso_offset(robot))

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Reduces the state in SI units and scales it to [-1, 1]."""
        task, gain, offset = _task_and_scaling(weights)
        numbers = self.reduce(task, scaled * gain + offset)
        return _divided(numbers - weights["latent.offset"], weights["latent.gain"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the encoded observation of a robot moved to the heading 0; see `restore`."""
        task, gain, offset = _task_and_scaling(weights)
        numbers = latents * weights["latent.gain"] + weights["latent.offset"]
        physical = self.restore(task, numbers, weights["center_of_mass"])
        return _divided(physical - offset, gain)


class PlanarWithoutYawRate(PlanarReduction):
    """`planar` without the yaw rate, to see what an agent loses that does not observe it."""

    def numbers(self, task: str, physical: Array) -> dict[str, Array]:
        """Returns those of `planar` but the yaw rate, which is 0 in what is decoded."""
        numbers = super().numbers(task, physical).items()
        return {name: value for name, value in numbers if name != "rate_z"}


class HeadingFrame(PlanarReduction):
    """The numbers of `planar` and those that it leaves out: the control for its coordinates.

    Nothing but the sign of the quaternion, which has no physical meaning, is left out.
    """

    def numbers(self, task: str, physical: Array) -> dict[str, Array]:
        """Returns planar numbers, x, y (m), cosine and sine of the heading h, and speed (m/s)."""
        by_name = split(task, physical)
        position = by_name["position"]
        _, _, _, cosine, sine = geometry.swing_and_twist(position[..., 3:])
        turn = {"x": position[..., 0], "y": position[..., 1], "cosine": cosine, "sine": sine}
        if "speed_in_target_frame" in by_name:
            speed = by_name["speed_in_target_frame"]
            turn |= _by_axis("speed", [speed[..., axis] for axis in range(3)])
        return super().numbers(task, physical) | turn


class PlanarMirror(PlanarReduction):
    """The planar reduction, folded by the robot's mirror symmetry (`features.mirrored`).

    Where the target is on the robot's right, the latents are those of the mirrored robot, whose
    target is on its left, and the robot gets the negated action of the policy. So the agent sees
    only half of the states, and each of its transitions stands for two.

    The side is the sign of the angle to the target. A task without it has the sign of the lateral
    component of the way to the target or, in `move_from_origin`, to the origin.
    """

    def numbers(self, task: str, physical: Array) -> dict[str, Array]:
        """The numbers of the mirror image if the target is on the right."""
        where = namespace(physical).where
        numbers = super().numbers(task, physical)
        side = numbers.get("angle")
        if side is None:
            side = numbers["target_x"]

        return {
            name: where(side < 0, SIGNS[name] * value, value) for name, value in numbers.items()
        }

    def action_signs(self, weights: Weights, scaled: Array) -> Array:
        """Returns -1 where the encoder shows the mirror image."""
        task, gain, offset = _task_and_scaling(weights)
        physical = scaled * gain + offset
        # An observed angle is a feature, without the rotations that take most of the time.
        side = split(task, physical).get("angle_to_target")
        if side is None:
            side = super().numbers(task, physical)["target_x"][..., None]
        xp = namespace(scaled)
        sign = xp.asarray([1], dtype=scaled.dtype, device=getattr(scaled, "device", None))
        return xp.where(side < 0, -sign, sign)


def planar_weights(
    task: str, scaling: Scaling, extremes: Scaling, center_of_mass: FloatArray
) -> dict[str, FloatArray]:
    """Returns the weights of the kind for scaling of the features and extremes of the latents."""
    gain, offset = physical_scaling(task, scaling)
    half_width, center = extremes.half_width_and_center()
    return {
        f"{task}.gain": gain,
        f"{task}.offset": offset,
        "latent.gain": half_width,
        "latent.offset": center,
        "center_of_mass": center_of_mass,
    }


def _task_and_scaling(weights: Weights) -> tuple[str, Array, Array]:
    """Returns the task, which is in names of weights; features in SI = gain * scaled + offset."""
    (task,) = (name for name in TASK_SPECS if f"{name}.gain" in weights)
    return task, weights[f"{task}.gain"], weights[f"{task}.offset"]


def _by_axis(name: str, values: Iterable[Array]) -> dict[str, Array]:
    """Returns the components of a vector by names such as velocity_x."""
    return {f"{name}_{axis}": value for axis, value in zip("xyz", values, strict=False)}


def _divided(values: Array, gain: Array) -> Array:
    """Returns values / gain, or 0 for constant features, whose gain is 0."""
    xp = namespace(values)
    return xp.where(gain != 0, values / xp.where(gain != 0, gain, 1.0), 0.0)
