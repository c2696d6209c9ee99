"""Loading the plain robot or an augmented one."""

import mujoco

from jbench.tasks import augmented, model

# Parts of the plain robot that can touch each other while shoulders and elbows are within 0.4 rad
# of the rest pose, at any angle of the motor. The spring of a joint that is bent further would have
# the energy of a fall from 19 cm. Pairs of two bodies are in the order of MuJoCo's contacts.
_NEIGHBORS = """
leg2_upper mass, leg3_upper mass, crank_handle leg1_lower, crank_handle leg4_lower,
leg2_lower leg3_lower, leg2_foot leg3_lower, leg2_foot leg3_foot, leg3_foot leg2_lower,
leg1_lower leg4_lower, leg1_foot leg4_lower, leg1_foot leg4_foot, leg4_foot leg1_lower
"""


def load_model(augment: int | None = None, *, vary_masses: bool = False) -> mujoco.MjModel:
    """Returns a new MuJoCo model of the plain robot, or of an augmented one with this seed.

    Raises:
        ValueError: if the seed is negative, or `vary_masses` is set for the plain robot.
    """
    if augment is None:
        if vary_masses:
            raise ValueError("Only the masses of an augmented robot vary: give its seed, augment")
        return _plain()
    return augmented.build(augmented.draw(augment, vary_masses=vary_masses))


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
