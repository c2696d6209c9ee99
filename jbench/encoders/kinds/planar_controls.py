"""The controls of `planar`: without the yaw rate, and with all that `planar` leaves out."""

from array_api_compat import array_namespace

from jbench.encoders.kinds.planar import (
    PlanarReduction,
    features_in,
    from_planar,
    planar_size,
    rotated_in_plane,
    swing_and_twist,
    to_planar,
)
from jbench.tasks.features import (
    TASK_SPECS,
    Array,
    State,
    Target,
    center_of_mass_velocity,
    split,
)

_YAW_RATE = 8  # its position among the numbers of `planar`


class PlanarWithoutYawRate(PlanarReduction):
    """`planar` without the yaw rate, to see what an agent loses that does not observe it."""

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the size of `planar` less one."""
        return range(planar_size(task) - 1, planar_size(task))

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the numbers of `planar` but the yaw rate."""
        planar = to_planar(task, physical)
        xp = array_namespace(planar)
        return xp.concat([planar[..., :_YAW_RATE], planar[..., _YAW_RATE + 1 :]], axis=-1)

    def restore(self, task: str, numbers: Array, center_of_mass: Array) -> Array:
        """Returns features of a robot whose yaw rate is 0."""
        xp = array_namespace(numbers)
        zero = xp.zeros_like(numbers[..., :1])
        planar = xp.concat([numbers[..., :_YAW_RATE], zero, numbers[..., _YAW_RATE:]], axis=-1)
        return super().restore(task, planar, center_of_mass)


class HeadingFrame(PlanarReduction):
    """The numbers of `planar` and those that it leaves out: the control for its coordinates.

    After the numbers of `planar` come x and y (m), cosine and sine of the heading h, and the speed
    in the target's frame if the task observes it (m/s). Nothing but the sign of the quaternion,
    which has no physical meaning, is left out.
    """

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the only possible size, 16 to 19."""
        size = planar_size(task) + 4 + 3 * ("speed_in_target_frame" in TASK_SPECS[task].features)
        return range(size, size + 1)

    def reduce(self, task: str, physical: Array) -> Array:
        """Returns the numbers listed above."""
        by_name = split(task, physical)
        position = by_name["position"]
        xp = array_namespace(position)
        _, _, _, cosine, sine = swing_and_twist(position[..., 3:])
        speed = [by_name[name] for name in ("speed_in_target_frame",) if name in by_name]
        turn = xp.stack([cosine, sine], axis=-1)
        return xp.concat([to_planar(task, physical), position[..., :2], turn, *speed], axis=-1)

    def restore(self, task: str, numbers: Array, center_of_mass: Array) -> Array:
        """Returns the encoded features, with a quaternion (w, x, y, z) of w >= 0."""
        size = planar_size(task)
        xp = array_namespace(numbers)
        state, target = from_planar(task, numbers[..., :size], center_of_mass)
        place, turn = numbers[..., size : size + 2], numbers[..., size + 2 : size + 4]
        length = xp.sqrt(xp.clip(xp.sum(turn * turn, axis=-1), 1e-12, None))
        cosine, sine = turn[..., 0] / length, turn[..., 1] / length
        return features_in(task, *_moved(state, target, place, cosine, sine, center_of_mass))


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
