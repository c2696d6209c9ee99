"""Robots of randomised morphology, and the domain `augmented_jitterbug` of the dm_control suite.

A seed makes a robot: the ends of its legs and its motor's mass are moved by normal shifts, and the
model's specification is edited accordingly, in memory. The standard deviations are those of the
authors' own augmented robots, which the paper leaves out: there an agent learns on ten of them,
one after the other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Unpack

import mujoco
import numpy as np
from dm_control.mujoco import wrapper
from dm_control.rl import control
from dm_control.utils import containers
from numpy.typing import NDArray

from jbench.errors import RequestError, WorkError
from jbench.tasks import features, jitterbug, model

Vector = tuple[float, float, float]
"""Along x, y and z of the torso's frame at rest, or along an ellipsoid's axes."""

LEGS = (1, 2, 3, 4)
"""The legs: 1 and 2 on the robot's left (x > 0), 2 and 3 at its front."""

# Standard deviations of the draws.
_LEG_SD = (0.003, 0.003, 0.002)  # m, of a knee or a foot
_MASS_SD = (0.0015, 0.002, 0.001)  # m
_SEMI_AXIS_SD = 0.0007  # m
_TORSO_UPPER_SD = 10.0  # kg/m^3
_TORSO_LOWER_SD = 80.0  # kg/m^3
_STEEL_SD = 200.0  # kg/m^3
_GEAR_SD = 0.001  # N m

# The mass moves forward (-y) and down by at most a millimetre: larger shifts are cut off there (m).
_LOWEST_MASS_SHIFT = (-math.inf, -0.001, -0.001)

# Where the wires of the legs leave the torso, seen from above: a rear corner of its upper box (m).
_CORNER = np.array([0.0055, 0.006])

# A robot stands for a second and is shaken for another before it is accepted.
_CHECKED_STEPS = 5000
# The least upright reward of a robot that stands (26.7 degrees of tilt). Every task's reward has
# this factor, and a task counts as solved at a return of 900: below it none could be. Uneven feet
# tilt a robot by a few degrees; one that has fallen lies at 60 or more.
_STANDING = 0.9
_MOST_REDRAWS = 100

_NO_SHIFT: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Morphology:
    """How a robot differs from the plain one; with every default it is the plain one.

    Attributes:
        seed: that the shifts were drawn from.
        redraws: number of draws before this one that gave no robot, or none that stands.
        knees: shift of each knee, in the order of `LEGS` (m).
        feet: shift of each foot, in the order of `LEGS`, wherever the knee went (m).
        mass: shift of the motor's eccentric mass (m).
        mass_semi_axes: change of the semi-axes of that ellipsoid (m).
        torso_upper_density: change of the density of the torso's upper box (kg/m^3).
        torso_lower_density: change of the density of the torso's lower box (kg/m^3).
        default_density: change of the density of all parts of steel (kg/m^3).
        gear: change of the motor's torque at full command (N m).
    """

    seed: int
    redraws: int = 0
    knees: tuple[Vector, ...] = (_NO_SHIFT,) * len(LEGS)
    feet: tuple[Vector, ...] = (_NO_SHIFT,) * len(LEGS)
    mass: Vector = _NO_SHIFT
    mass_semi_axes: Vector = _NO_SHIFT
    torso_upper_density: float = 0.0
    torso_lower_density: float = 0.0
    default_density: float = 0.0
    gear: float = 0.0


@lru_cache(maxsize=1024)
def draw(seed: int, *, vary_masses: bool = False) -> Morphology:
    """Returns the morphology of a seed: the first of its draws that gives a robot that stands.

    Args:
        seed: 0 or more; the only source of the random numbers.
        vary_masses: whether densities and the motor's gear are drawn, too.

    Raises:
        RequestError: if the seed is negative; a ValueError.
        WorkError: if a hundred redraws gave no robot that stands.
    """
    if seed < 0:
        raise RequestError(f"An augmented robot has no seed {seed}: use 0 or more.")
    source = np.random.SeedSequence(seed)
    for redraws in range(_MOST_REDRAWS + 1):
        (child,) = source.spawn(1)
        morphology = _draw_once(seed, redraws, np.random.default_rng(child), vary_masses)
        if is_usable(morphology):
            return morphology
    raise WorkError(f"None of {_MOST_REDRAWS + 1} draws of seed {seed} stands: use another.")


def _draw_once(
    seed: int, redraws: int, random: np.random.Generator, vary_masses: bool
) -> Morphology:
    """Returns a morphology that may or may not give a robot; masses are drawn last."""
    knees, feet = (
        tuple(_vector(shift) for shift in random.normal(0, _LEG_SD, (len(LEGS), 3)))
        for _ in range(2)
    )
    mass = _vector(np.maximum(random.normal(0, _MASS_SD), _LOWEST_MASS_SHIFT))
    semi_axes = _vector(random.normal(0, _SEMI_AXIS_SD, 3))
    if not vary_masses:
        return Morphology(seed, redraws, knees, feet, mass, semi_axes)
    deviations = (_TORSO_UPPER_SD, _TORSO_LOWER_SD, _STEEL_SD, _GEAR_SD)
    return Morphology(
        seed, redraws, knees, feet, mass, semi_axes, *random.normal(0, deviations).tolist()
    )


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def augmented_model(seed: int, *, vary_masses: bool = False) -> mujoco.MjModel:
    """Returns a new MuJoCo model of the robot of a seed; arguments and errors as of `draw`."""
    return build(draw(seed, vary_masses=vary_masses))


def build(morphology: Morphology) -> mujoco.MjModel:
    """Returns a new MuJoCo model of the plain robot changed by a morphology.

    Raises:
        ValueError: if such a robot cannot be: a size or a mass is not positive.
    """
    spec = mujoco.MjSpec.from_string(model.xml())
    for leg, knee, foot in zip(LEGS, morphology.knees, morphology.feet, strict=True):
        _move_leg(spec, leg, np.array(knee), np.array(foot))
    mass = spec.geom("mass")
    mass.pos = mass.pos + morphology.mass
    mass.size = mass.size + morphology.mass_semi_axes
    _change_densities(spec, morphology)
    motor = spec.actuator("motor")
    motor.gear = motor.gear + np.array([morphology.gear, 0, 0, 0, 0, 0])
    return spec.compile()


def hinge_axis(leg: int, knee: NDArray[np.float64]) -> Vector:
    """Returns the axis (not normalised) of a leg's shoulder and elbow.

    With (x, y) the way from the corner of the torso's upper box, (.0055, .006) on the left and
    (-.0055, .006) on the right, to the knee, seen from above, the plain robot's axes are (x, -y)
    for the back legs and (-x, y) for the front ones: (2.32, -2.68) for leg 1 in centimetres. So
    they are horizontal, but not at a right angle to their legs, and so are the augmented ones.

    Args:
        leg: one of `LEGS`.
        knee: (3,) or (2,) place in the torso's frame at rest (m).
    """
    side = 1 if leg in (1, 2) else -1
    x, y = knee[:2] - _CORNER * (side, 1)
    return (x, -y, 0.0) if leg in (1, 4) else (-x, y, 0.0)


def _move_leg(
    spec: mujoco.MjSpec, leg: int, knee_shift: NDArray[np.float64], foot_shift: NDArray[np.float64]
) -> None:
    """Moves a knee and a foot with everything that ends or turns there."""
    upper, lower = spec.geom(f"leg{leg}_upper"), spec.geom(f"leg{leg}_lower")
    shoulder, elbow = spec.joint(f"leg{leg}_shoulder"), spec.joint(f"leg{leg}_elbow")
    knee, foot = spec.geom(f"leg{leg}_knee"), spec.geom(f"leg{leg}_foot")
    # The upper wire goes from the knee to the torso, the lower one from the foot to the knee.
    upper.fromto = upper.fromto + np.concatenate([knee_shift, np.zeros(3)])
    lower.fromto = lower.fromto + np.concatenate([foot_shift, knee_shift])
    for part in (knee, elbow):
        part.pos = part.pos + knee_shift
    foot.pos = foot.pos + foot_shift
    shoulder.axis = elbow.axis = hinge_axis(leg, knee.pos)


def _change_densities(spec: mujoco.MjSpec, morphology: Morphology) -> None:
    """Changes the densities of steel and of the torso's boxes."""
    steel = spec.default.geom.density
    # A geom took over its default density when it was read: changing the default is too late.
    for geom in spec.geoms:
        if geom.density == steel:
            geom.density = steel + morphology.default_density
    spec.geom("torso_upper").density += morphology.torso_upper_density
    spec.geom("torso_lower").density += morphology.torso_lower_density


def is_usable(morphology: Morphology) -> bool:
    """Returns whether a robot compiles, stands, and steps at full torque without a bad state."""
    try:
        robot = build(morphology)
    except ValueError:
        return False
    return standing_reward(robot) > _STANDING


def standing_reward(robot: mujoco.MjModel) -> float:
    """Returns the upright reward of a robot after a second without torque.

    It starts in the rest pose, and settles on its feet, which may begin above or in the floor.
    Another second at full torque follows; 0 if MuJoCo warns of anything in either second, such as
    a state that is not finite, or huge (from which it resets the robot to standing upright).
    """
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0, 0, 0]))
    mujoco.mj_step(robot, data, nstep=_CHECKED_STEPS)
    state = model.state_of(data.qpos, data.qvel, model.torso_offset(robot))
    data.ctrl[:] = 1
    mujoco.mj_step(robot, data, nstep=_CHECKED_STEPS)
    return 0.0 if data.warning.number.any() else float(features.upright_reward(state))


SUITE = containers.TaggedTasks()


def _factory(task: str, description: str) -> Callable[..., control.Environment]:
    """Returns the function that makes the environment of a task."""

    def make(
        augment: int = 0,
        vary_masses: bool = False,
        **settings: Unpack[jitterbug.TaskSettings],
    ) -> control.Environment:
        # The compiled model itself: written as XML it would keep only six digits of each number.
        robot = augmented_model(augment, vary_masses=vary_masses)
        physics = jitterbug.Physics.from_model(wrapper.MjModel(robot))
        return jitterbug.environment(task, physics, **settings)

    make.__name__, make.__doc__ = task, description
    return make


# The plain robot's five tasks, which also take `augment` (a seed, default 0) and `vary_masses`.
# Not among the benchmarking ones: one seed's results are not another's.
for _task, _plain in jitterbug.SUITE.items():
    SUITE.add()(_factory(_task, _plain.__doc__))
