"""The plain robot, and augmented ones, of randomized morphology.

A seed determines an augmented robot: normally distributed shifts move the ends of its legs and its
motor's mass, and the model's specification is edited in memory. The standard deviations are those
of the authors' augmented robots, which the paper does not describe; there an agent trains on ten of
them in sequence.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError, WorkError
from jbench.tasks.jitterbug import model, rewards

Vector = tuple[float, ...]
"""Components along x, y and z of the torso's frame at rest, or along an ellipsoid's axes."""

LEGS = (1, 2, 3, 4)  # the legs: 1 and 2 on the robot's left (x > 0), 2 and 3 at its front

# Standard deviations.
_LEG_SD = (0.003, 0.003, 0.002)  # m, of knees and feet
_MASS_SD = (0.0015, 0.002, 0.001)  # m
_SEMI_AXIS_SD = 0.0007  # m
# Of what varies with the masses, in the order of the draws: densities (kg/m^3) and torque (N m).
_MASSES_SD = {
    "torso_upper_density": 10.0,
    "torso_lower_density": 80.0,
    "default_density": 200.0,
    "gear": 0.001,
}

# Shifts of the mass forward (-y) and down are limited to a millimeter (m).
_MIN_MASS_SHIFT = (-math.inf, -0.001, -0.001)

# Point where the legs leave the torso, seen from above: a rear corner of its upper box (m).
_CORNER = np.array([0.0055, 0.006])

# A robot must stand for one second, and is then simulated at full torque for another.
_CHECKED_STEPS = 5000
# Least "upright" term of the reward of a robot that stands, at 26.7 degrees of tilt. The term is a
# factor of every task's reward, and a task counts as solved at a return of 900, which is impossible
# below this. Uneven feet tilt a robot by a few degrees; a fallen robot is tilted by 60 or more.
_MIN_UPRIGHT = 0.9
_MAX_REDRAWS = 100
_NO_SHIFT: Vector = (0.0, 0.0, 0.0)

# Parts of the plain robot that can touch each other while shoulders and elbows are within 0.4 rad
# of the rest pose, at any angle of the motor. The spring of a joint that is bent further would have
# the energy of a fall from 19 cm. Pairs of two bodies are in the order of MuJoCo's contacts.
_NEIGHBORS = """
leg2_upper mass, leg3_upper mass, crank_handle leg1_lower, crank_handle leg4_lower,
leg2_lower leg3_lower, leg2_foot leg3_lower, leg2_foot leg3_foot, leg3_foot leg2_lower,
leg1_lower leg4_lower, leg1_foot leg4_lower, leg1_foot leg4_foot, leg4_foot leg1_lower
"""


@dataclass(frozen=True, kw_only=True)
class Morphology:
    """Differences from the plain robot; the defaults are the plain robot."""

    seed: int  # of the shifts
    redraws: int = 0  # number of rejected draws before this one
    knees: tuple[Vector, ...] = (_NO_SHIFT,) * len(LEGS)  # shifts, in the order of `LEGS` (m)
    feet: tuple[Vector, ...] = (_NO_SHIFT,) * len(LEGS)  # shifts, independent of the knees (m)
    mass: Vector = _NO_SHIFT  # shift of the motor's eccentric mass (m)
    mass_semi_axes: Vector = _NO_SHIFT  # change of the semi-axes of that ellipsoid (m)
    torso_upper_density: float = 0.0  # change of the density of the torso's upper box (kg/m^3)
    torso_lower_density: float = 0.0  # change of the density of the torso's lower box (kg/m^3)
    default_density: float = 0.0  # change of the density of all parts of steel (kg/m^3)
    gear: float = 0.0  # change of the motor's torque at full command (N m)


def load_model(augment: int | None = None, *, vary_masses: bool = False) -> mujoco.MjModel:
    """Returns a new MuJoCo model of the plain robot, or of an augmented one with this seed.

    Raises:
        ValueError: if the seed is negative, or `vary_masses` is set for the plain robot.
    """
    if augment is None:
        if vary_masses:
            raise ValueError("Only the masses of an augmented robot vary: give its seed, augment")
        return _plain()
    return build(draw(augment, vary_masses=vary_masses))


def _plain() -> mujoco.MjModel:
    """Returns the plain robot, which steps faster than the model of the XML to the same states.

    MuJoCo tests an explicit list of pairs of geoms for contacts, instead of searching for pairs,
    and does not search for islands, since there is only one. A pair's default parameters are those
    of its geoms.
    """
    spec = mujoco.MjSpec.from_string(model.xml())
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    floor, *parts = [geom for geom in spec.geoms if geom.contype]
    for geom in (floor, *parts):
        geom.contype = geom.conaffinity = 0

    neighbors = [pair.split() for pair in _NEIGHBORS.split(",")]
    for first, second in (*([floor.name, part.name] for part in parts), *neighbors):
        spec.add_pair(geomname1=first, geomname2=second)

    return spec.compile()


@lru_cache(maxsize=1024)
def draw(seed: int, *, vary_masses: bool = False) -> Morphology:
    """Returns the morphology of a seed: its first draw whose robot stands.

    Raises:
        RequestError: if the seed is not a whole number of at least 0; a ValueError.
        WorkError: if no robot stands after a hundred redraws.
    """
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise RequestError(f"An augmented robot has no seed {seed!r}: use 0 or more.")

    source = np.random.SeedSequence(seed)
    for redraws in range(_MAX_REDRAWS + 1):
        random = np.random.default_rng(*source.spawn(1))
        knees = _draw_leg_shifts(random)
        feet = _draw_leg_shifts(random)
        mass = np.maximum(random.normal(0, _MASS_SD), _MIN_MASS_SHIFT)
        semi_axes = random.normal(0, _SEMI_AXIS_SD, 3)
        masses = dict[str, float]()
        if vary_masses:
            changes = random.normal(0, list(_MASSES_SD.values()))
            masses = dict(zip(_MASSES_SD, changes.tolist(), strict=True))

        morphology = Morphology(
            seed=seed,
            redraws=redraws,
            knees=knees,
            feet=feet,
            mass=tuple(mass.tolist()),
            mass_semi_axes=tuple(semi_axes.tolist()),
            **masses,
        )
        if is_usable(morphology):
            return morphology

    raise WorkError(f"None of {_MAX_REDRAWS + 1} draws of seed {seed} stands: use another.")


def _draw_leg_shifts(random: np.random.Generator) -> tuple[Vector, ...]:
    """Returns shifts of the knees or the feet, one for each of `LEGS` (m)."""
    shifts = random.normal(0, _LEG_SD, (len(LEGS), 3))
    return tuple(tuple(shift) for shift in shifts.tolist())


def build(morphology: Morphology) -> mujoco.MjModel:
    """Returns a new MuJoCo model; a size or a mass that is not positive is a ValueError."""
    spec = mujoco.MjSpec.from_string(model.xml())
    for leg, knee_shift, foot_shift in zip(LEGS, morphology.knees, morphology.feet, strict=True):
        upper = spec.geom(f"leg{leg}_upper")
        lower = spec.geom(f"leg{leg}_lower")
        shoulder = spec.joint(f"leg{leg}_shoulder")
        elbow = spec.joint(f"leg{leg}_elbow")
        knee = spec.geom(f"leg{leg}_knee")
        foot = spec.geom(f"leg{leg}_foot")

        # `fromto` of the upper wire is knee, torso; that of the lower wire is foot, knee.
        upper.fromto = upper.fromto + np.array([*knee_shift, *_NO_SHIFT])
        lower.fromto = lower.fromto + np.array([*foot_shift, *knee_shift])
        for part in (knee, elbow):
            part.pos = part.pos + knee_shift

        foot.pos = foot.pos + foot_shift
        shoulder.axis = elbow.axis = hinge_axis(leg, knee.pos)

    mass = spec.geom("mass")
    mass.pos = mass.pos + morphology.mass
    mass.size = mass.size + morphology.mass_semi_axes
    steel = spec.default.geom.density
    # Geoms copied the default density when they were parsed, so changing the default has no effect.
    for geom in spec.geoms:
        if geom.density == steel:
            geom.density = steel + morphology.default_density

    spec.geom("torso_upper").density += morphology.torso_upper_density
    spec.geom("torso_lower").density += morphology.torso_lower_density
    motor = spec.actuator("motor")
    motor.gear = motor.gear + np.array([morphology.gear, 0, 0, 0, 0, 0])
    return spec.compile()


def hinge_axis(leg: int, knee: NDArray[np.float64]) -> Vector:
    """Returns the axis (not normalized) of a leg's shoulder and elbow, given its knee at rest (m).

    Let (x, y) be the vector from the corner of the torso's upper box, (.0055, .006) on the left and
    (-.0055, .006) on the right, to the knee, seen from above. The plain robot's axes are (x, -y)
    for the back legs and (-x, y) for the front ones, (2.32, -2.68) for leg 1 in centimeters. They
    are horizontal, but not perpendicular to the legs; augmented robots follow the same rule.
    """
    side = 1 if leg in (1, 2) else -1
    x, y = knee[:2] - _CORNER * (side, 1)
    return (x, -y, 0.0) if leg in (1, 4) else (-x, y, 0.0)


def is_usable(morphology: Morphology) -> bool:
    """Returns whether a robot compiles, stands, and is stable at full torque."""
    try:
        robot = build(morphology)
    except ValueError:
        return False
    return standing_reward(robot) > _MIN_UPRIGHT


def standing_reward(robot: mujoco.MjModel) -> float:
    """Returns the upright reward of a robot after a second without torque.

    It starts in the rest pose with its feet above or below the floor, and settles. Another second
    at full torque follows. Returns 0 if MuJoCo warns in either second, for example about a state
    that is not finite or huge (after which it would reset the robot to the upright pose).
    """
    data = mujoco.MjData(robot)
    model.place(data, model.UPRIGHT)
    mujoco.mj_step(robot, data, nstep=_CHECKED_STEPS)
    state = model.read_state(data.qpos, data.qvel, model.torso_offset(robot))
    data.ctrl[:] = 1
    mujoco.mj_step(robot, data, nstep=_CHECKED_STEPS)
    return 0.0 if data.warning.number.any() else float(rewards.upright_reward(state))
