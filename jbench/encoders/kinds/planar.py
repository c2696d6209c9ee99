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
world rotated by h. The latents, in the heading frame and in this order:

    height                                          1   m
    tilt: a and b above, sin(angle / 2) of the tilt 2
    velocity of the torso's frame                   3   m/s
    angular velocity                                3   rad/s
    motor angle and speed, as observed              2   rad, rad/s
    from the robot to its target, horizontally      2   m, if the reward depends on the position
    angle to the target, as observed                1   rad, if the task observes it

`move_from_origin` has no target, but its reward depends on the distance from the origin, which
takes the target's place: only rotations about the origin are symmetries of this task.
"""

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from array_api_compat import array_namespace
from numpy.typing import NDArray

from jbench.encoders.kind import Fitted, Weights
from jbench.encoders.moments import FloatArray
from jbench.encoders.scaling import Scaling
from jbench.tasks import model
from jbench.tasks.features import (
    TARGET_HEIGHT,
    TASK_SPECS,
    Array,
    State,
    Target,
    center_of_mass_velocity,
    denormalize,
    features,
    heading,
    rotate,
    rotation_matrix,
    split,
)
from jbench.tasks.robots import load_model

if TYPE_CHECKING:
    from jbench.encoders.states import States

_ROBOT_SIZE = 11  # numbers that all tasks have
_UPSIDE_DOWN = 1e-12  # squared cosine of half the tilt, at the precision of float32


class PlanarReduction(Fitted):
    """The observation modulo translation and rotation in the plane.

    Each latent is scaled to [-1, 1] by its extremes over the dataset, like the inputs of every
    kind, so agents on `planar` and on `scaled` differ only in the reduction.
    """

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the only possible size, 11 to 14."""
        size = planar_size(task)
        return range(size, size + 1)

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the latents (..., latents) before scaling, for features in SI units."""
        return to_planar(task, physical)

    def restore(self, task: str, numbers: Array, center_of_mass: Array) -> Array:
        """Returns features (..., dim(O)) in SI units of a robot with these latents."""
        return features_in(task, *from_planar(task, numbers, center_of_mass))

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        """Returns the scalings of features and latents, and the torso's center of mass."""
        gain, offset = physical_scaling(states.task, states.scaling)
        shards = (shard.states.cpu().double().numpy() * gain + offset for shard in states.all())
        scalings = (Scaling.of(self.reduce(states.task, physical)) for physical in shards)
        extremes = reduce(Scaling.merged, scalings)
        augment = states.dataset.record.settings.get("augment")
        return planar_weights(
            states.task, states.scaling, extremes, model.torso_offset(load_model(augment))
        )

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the scaled numbers listed in the module's docstring."""
        task, physical = task_and_features(weights, scaled)
        numbers = self.reduce(task, physical) - weights["latent.offset"]
        return _divided(numbers, weights["latent.gain"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the observation of a robot with heading 0 at the origin.

        It equals the encoded observation up to a motion in the plane (`move_from_origin`: a
        rotation about the origin).
        """
        task = _task(weights)
        numbers = latents * weights["latent.gain"] + weights["latent.offset"]
        physical = self.restore(task, numbers, weights["center_of_mass"])
        return _divided(physical - weights[f"{task}.offset"], weights[f"{task}.gain"])


def planar_size(task: str) -> int:
    """Returns the number of latents of a task."""
    angle = "angle_to_target" in TASK_SPECS[task].features
    return _ROBOT_SIZE + 2 * TASK_SPECS[task].rewards_position + angle


def planar_weights(
    task: str, scaling: Scaling, extremes: Scaling, center_of_mass: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Returns the weights of the kind; their names contain the task.

    Args:
        scaling: of the observation's features.
        extremes: (planar_size,) extremes of the unscaled latents.
        center_of_mass: (3,) of the torso in its own frame (m).
    """
    gain, offset = physical_scaling(task, scaling)
    latent_scaling = extremes.half_width_and_center()
    return {
        f"{task}.gain": gain,
        f"{task}.offset": offset,
        "latent.gain": latent_scaling[0],
        "latent.offset": latent_scaling[1],
        "center_of_mass": center_of_mass,
    }


def physical_scaling(task: str, scaling: Scaling) -> tuple[FloatArray, FloatArray]:
    """Returns (dim(O),) gain and offset: features in SI units = gain * scaled + offset."""
    gain, offset = scaling.half_width_and_center()
    center = denormalize(task, offset)
    return denormalize(task, offset + gain) - center, center


def task_and_features(weights: Weights, scaled: Array) -> tuple[str, Array]:
    """Returns the task of the weights, and features in SI units for scaled ones."""
    task = _task(weights)
    return task, scaled * weights[f"{task}.gain"] + weights[f"{task}.offset"]


def to_planar(task: str, physical: Array) -> Array:
    """Returns unscaled latents (..., planar_size) for features (..., dim(O)) in SI units."""
    xp = array_namespace(physical)
    by_name = split(task, physical)
    length, a, b, cosine, sine = swing_and_twist(by_name["position"][..., 3:])
    velocity = by_name["velocity"]
    along, across = rotated_in_plane(cosine, -sine, velocity[..., 0], velocity[..., 1])
    numbers = [
        *(by_name["position"][..., 2], a, b, along, across, velocity[..., 2]),
        *_tilted(length, a, b, velocity[..., 3:]),
        *(by_name["motor_position"][..., 0], by_name["motor_velocity"][..., 0]),
    ]
    if "target_in_jitterbug_frame" in by_name:
        numbers += _tilted(length, a, b, by_name["target_in_jitterbug_frame"])[:2]
    elif TASK_SPECS[task].rewards_position:
        to_origin = -by_name["position"][..., :2]
        numbers += rotated_in_plane(cosine, -sine, to_origin[..., 0], to_origin[..., 1])
    if "angle_to_target" in by_name:
        numbers.append(by_name["angle_to_target"][..., 0])
    return xp.stack(numbers, axis=-1)


def from_planar(task: str, planar: Array, center_of_mass: Array) -> tuple[State, Target]:
    """Returns a robot with these planar numbers, and its target.

    Its heading h is 0, and it is at the origin; in `move_from_origin` it is where they say.

    Args:
        planar: (..., planar_size) as `to_planar` returns them.
        center_of_mass: (3,) of the torso in its own frame (m).
    """
    xp = array_namespace(planar)
    height, a, b = (planar[..., i] for i in range(3))
    zero = xp.zeros_like(height)
    rest = planar[..., _ROBOT_SIZE:]
    target = [zero, zero]
    if TASK_SPECS[task].rewards_position:
        target = [rest[..., 0], rest[..., 1]]
    place = [zero, zero]
    if not TASK_SPECS[task].draws_position:
        place, target = [-part for part in target], place
    upright = xp.sqrt(xp.clip(1 - a * a - b * b, 0.0, 1.0))
    position = xp.stack([*place, height, upright, a, b, zero], axis=-1)
    back = xp.matrix_transpose(rotation_matrix(position[..., 3:]))
    velocity = xp.concat([planar[..., 3:6], rotate(back, planar[..., 6:9])], axis=-1)
    state = State(
        position=position,
        velocity=velocity,
        motor_position=planar[..., 9],
        motor_velocity=planar[..., 10],
        torso_velocity=center_of_mass_velocity(position, velocity, center_of_mass),
    )
    # The last number is the angle to the target if the task observes it.
    return state, Target(
        xp.stack([*target, zero + TARGET_HEIGHT], axis=-1), planar[..., -1] + heading(state)
    )


def features_in(task: str, state: State, target: Target) -> Array:
    """Returns features (..., dim(O)) in SI units."""
    xp = array_namespace(state.position)
    return xp.concat(list(features(task, state, target).values()), axis=-1)


def swing_and_twist(quaternion: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Returns c, a and b of the tilt, and cosine and sine of the heading h; see above."""
    xp = array_namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    # The heading is undefined upside down: it is set to 0.
    has_heading = w * w + z * z > _UPSIDE_DOWN
    w, z = xp.where(has_heading, w, 1.0), xp.where(has_heading, z, 0.0)
    square = w * w + z * z
    c = xp.sqrt(square)
    a, b = (w * x + z * y) / c, (w * y - z * x) / c
    return c, a, b, (w * w - z * z) / square, 2 * w * z / square


def _task(weights: Weights) -> str:
    """Returns the task in the names of the weights."""
    for task in TASK_SPECS:
        if f"{task}.gain" in weights:
            return task
    raise KeyError("no weights of a task")


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
