"""The reduction of an observation by translation and rotation in the plane.

Rewards and dynamics do not change when robot and target are translated on the floor or rotated
about the vertical together. An observation modulo this symmetry determines the rewards and the
changes of the state with fewer numbers.

The symmetry is exact except for the friction cone: MuJoCo's default is a pyramid along the world
axes, so the simulated robot is symmetric under translations and quarter turns to rounding, and
under other rotations only with an elliptic cone. The reduction loses only the direction of the
pyramid.

The orientation q is split into a rotation about the vertical and a tilt (the swing-twist
decomposition): q = (cos(h/2), 0, 0, sin(h/2)) * (c, a, b, 0) with c >= 0. The heading frame is the
world rotated by h. The latents are the `SIGNS` of a task, in this order, in the heading frame.
`move_from_origin` has no target, but its reward depends on the distance from the origin, which
takes the target's place: only rotations about the origin are symmetries of this task.
"""

import itertools
from collections.abc import Iterable
from functools import reduce

import numpy as np
from array_api_compat import array_namespace

from jbench.encoders.kind import Fitted, Weights
from jbench.encoders.scaling import FloatArray, Scaling, physical_scaling
from jbench.encoders.states import States
from jbench.task_specs import TASK_SPECS
from jbench.tasks import geometry, model
from jbench.tasks.features import features, observation_size, split
from jbench.tasks.geometry import Array, State, Target
from jbench.tasks.robots import load_model

SIGNS = {
    "height": 1,  # m
    "tilt_a": 1,  # a and b above, sin(angle / 2) of the tilt
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

Numbers = dict[str, Array]  # unscaled latents (...) by name


class PlanarReduction(Fitted):
    """The observation modulo translation and rotation in the plane.

    Each latent is scaled to [-1, 1] by its extremes over the dataset, like the inputs of every
    kind, so agents on `planar` and on `scaled` differ only in the reduction.
    """

    @classmethod
    def columns(cls, task: str) -> tuple[str, ...]:
        """Returns the names of the latents of a task, in order."""
        return tuple(cls().numbers(task, np.zeros(observation_size(task))))

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        size = len(cls.columns(task))
        return range(size, size + 1)

    def numbers(self, task: str, physical: Array) -> Numbers:
        """Returns the latents before scaling, for features (..., dim(O)) in SI units."""
        by_name = split(task, physical)
        position, velocity = by_name["position"], by_name["velocity"]
        length, a, b, cosine, sine = swing_and_twist(position[..., 3:])
        along, across = rotated_in_plane(cosine, -sine, velocity[..., 0], velocity[..., 1])
        numbers = {
            **{"height": position[..., 2], "tilt_a": a, "tilt_b": b},
            **by_axis("velocity", [along, across, velocity[..., 2]]),
            **by_axis("rate", _tilted(length, a, b, velocity[..., 3:])),
            "motor_angle": by_name["motor_position"][..., 0],
            "motor_speed": by_name["motor_velocity"][..., 0],
        }
        if "target_in_jitterbug_frame" in by_name:
            way = _tilted(length, a, b, by_name["target_in_jitterbug_frame"])
            numbers |= by_axis("target", way[:2])
        elif "away" in TASK_SPECS[task].rewards:
            way = rotated_in_plane(cosine, -sine, -position[..., 0], -position[..., 1])
            numbers |= by_axis("target", way)
        if "angle_to_target" in by_name:
            numbers["angle"] = by_name["angle_to_target"][..., 0]
        return numbers

    def robot(self, task: str, numbers: Numbers, center_of_mass: Array) -> tuple[State, Target]:
        """Returns a robot with these numbers, or 0 for those that lack, and its target.

        Unless the numbers say its place and turn (`HeadingFrame`), its heading h is 0, and it is at
        the origin; in `move_from_origin` it is on the other side of the way to the origin. The
        torso's center of mass (3,) is in its own frame (m).
        """
        height, a, b = numbers["height"], numbers["tilt_a"], numbers["tilt_b"]
        xp = array_namespace(height)
        zero = xp.zeros_like(height)

        def vector(name: str) -> list[Array]:
            return [numbers.get(f"{name}_{axis}", zero) for axis in "xyz"]

        *way, _ = vector("target")
        home = [zero, zero] if "x" in TASK_SPECS[task].target else [-part for part in way]
        place = [numbers.get(axis, part) for axis, part in zip("xy", home, strict=True)]
        cosine, sine = numbers.get("cosine", zero + 1), numbers.get("sine", zero)
        length = xp.sqrt(xp.clip(cosine * cosine + sine * sine, 1e-12, None))
        cosine, sine = cosine / length, sine / length
        c = xp.sqrt(xp.clip(1 - a * a - b * b, 0.0, 1.0))
        tilt = xp.stack([zero, zero, zero, c, a, b, zero], axis=-1)
        # (cos(h/2), 0, 0, sin(h/2)) times the quaternion (c, a, b, 0) of the tilt.
        half = xp.sqrt(xp.clip((1 + cosine) / 2, 0.0, None))
        half_sine = xp.sqrt(xp.clip((1 - cosine) / 2, 0.0, None))
        half_sine = xp.where(sine < 0, -half_sine, half_sine)
        quaternion = [half * c, half * a - half_sine * b, half * b + half_sine * a, half_sine * c]
        position = xp.stack([*place, height, *quaternion], axis=-1)
        along, across, up = vector("velocity")
        speeds = [*rotated_in_plane(cosine, sine, along, across), up]
        back = xp.matrix_transpose(geometry.rotation_matrix(tilt[..., 3:]))
        rates = geometry.rotate(back, xp.stack(vector("rate"), axis=-1))
        velocity = xp.concat([xp.stack(speeds, axis=-1), rates], axis=-1)
        state = State(
            position=position,
            velocity=velocity,
            motor_position=numbers["motor_angle"],
            motor_velocity=numbers["motor_speed"],
            torso_velocity=geometry.center_of_mass_velocity(position, velocity, center_of_mass),
        )
        turned = rotated_in_plane(cosine, sine, *way)
        target = [part + shift for part, shift in zip(turned, place, strict=True)]
        yaw = numbers.get("angle", zero) + geometry.heading(state._replace(position=tilt))
        height = zero + geometry.TARGET_HEIGHT
        return state, Target(xp.stack([*target, height], axis=-1), yaw + xp.atan2(sine, cosine))

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the `numbers` as an array (..., latents)."""
        numbers = self.numbers(task, physical)
        return array_namespace(physical).stack(list(numbers.values()), axis=-1)

    def restore(self, task: str, latents: Array, center_of_mass: Array) -> Array:
        """Returns features (..., dim(O)) in SI units of a robot with these unscaled latents."""
        numbers = {name: latents[..., i] for i, name in enumerate(self.columns(task))}
        values = features(task, *self.robot(task, numbers, center_of_mass))
        return array_namespace(latents).concat(list(values.values()), axis=-1)

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        gain, offset = physical_scaling(states.task, states.scaling)
        shards = itertools.chain(states.learn(), states.test())
        seen = (shard.states.cpu().double().numpy() * gain + offset for shard in shards)
        numbers = (self.reduce(states.task, physical) for physical in seen)
        extremes = reduce(Scaling.merged, map(Scaling.of, numbers))
        robot = load_model(states.dataset.record.settings.get("augment"))
        return planar_weights(states.task, states.scaling, extremes, model.torso_offset(robot))

    def encode(self, weights: Weights, scaled: Array) -> Array:
        numbers = self.reduce(*task_and_features(weights, scaled))
        return _divided(numbers - weights["latent.offset"], weights["latent.gain"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the observation of a robot with heading 0 at the origin.

        It equals the encoded observation up to a motion in the plane (`move_from_origin`: a
        rotation about the origin).
        """
        task = _task(weights)
        numbers = latents * weights["latent.gain"] + weights["latent.offset"]
        physical = self.restore(task, numbers, weights["center_of_mass"])
        return _divided(physical - weights[f"{task}.offset"], weights[f"{task}.gain"])


def planar_weights(
    task: str, scaling: Scaling, extremes: Scaling, center_of_mass: FloatArray
) -> dict[str, FloatArray]:
    """Returns the weights of the kind for scaling of the features and extremes of the latents."""
    gain, offset = physical_scaling(task, scaling)
    half_width, center = extremes.half_width_and_center()
    return {
        **{f"{task}.gain": gain, f"{task}.offset": offset},
        **{"latent.gain": half_width, "latent.offset": center},
        "center_of_mass": center_of_mass,
    }


def _task(weights: Weights) -> str:
    """Returns the task, which the names of the weights contain."""
    (task,) = (name for name in TASK_SPECS if f"{name}.gain" in weights)
    return task


def task_and_features(weights: Weights, scaled: Array) -> tuple[str, Array]:
    """Returns the task of the weights, and features in SI units for scaled ones."""
    task = _task(weights)
    return task, scaled * weights[f"{task}.gain"] + weights[f"{task}.offset"]


def by_axis(name: str, values: Iterable[Array]) -> Numbers:
    """Returns the components of a vector by names such as velocity_x."""
    return {f"{name}_{axis}": value for axis, value in zip("xyz", values, strict=False)}


def swing_and_twist(quaternion: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Returns c, a and b of the tilt, and cosine and sine of the heading h; see above."""
    xp = array_namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    # The heading is undefined upside down: it is set to 0.
    has_heading = w * w + z * z > 1e-12  # at the precision of float32
    w, z = xp.where(has_heading, w, 1.0), xp.where(has_heading, z, 0.0)
    square = w * w + z * z
    c = xp.sqrt(square)
    a, b = (w * x + z * y) / c, (w * y - z * x) / c
    return c, a, b, (w * w - z * z) / square, 2 * w * z / square


def rotated_in_plane(cosine: Array, sine: Array, x: Array, y: Array) -> list[Array]:
    """Returns the components of a horizontal vector rotated by an angle."""
    return [cosine * x - sine * y, sine * x + cosine * y]


def _tilted(c: Array, a: Array, b: Array, vector: Array) -> list[Array]:
    """Returns the components of a vector (..., 3) rotated by the quaternion (c, a, b, 0)."""
    x, y, z = (vector[..., i] for i in range(3))
    # v + 2 c t + 2 u x t with u = (a, b, 0) and t = u x v.
    tx, ty, tz = 2 * b * z, -2 * a * z, 2 * (a * y - b * x)
    return [x + c * tx + b * tz, y + c * ty - a * tz, z + c * tz + a * ty - b * tx]


def _divided(values: Array, gain: Array) -> Array:
    """Returns values / gain, or 0 for constant features, whose gain is 0."""
    xp = array_namespace(values)
    changes = gain != 0
    return xp.where(changes, values / xp.where(changes, gain, 1.0), 0.0)
