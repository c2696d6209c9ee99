"""Loading the plain robot or an augmented one."""

import mujoco

from jbench.tasks import augmented, model


def load_model(augment: int | None = None, *, vary_masses: bool = False) -> mujoco.MjModel:
    """Returns a new MuJoCo model of the plain robot, or of an augmented one.

    Args:
        augment: seed of the augmented robot's morphology (see `jbench.tasks.augmented.draw`), or
            None for the plain robot.
        vary_masses: whether to vary the augmented robot's densities and gear as well.

    Raises:
        ValueError: if the seed is negative, or `vary_masses` is set for the plain robot.
    """
    if augment is None:
        if vary_masses:
            raise ValueError("Only the masses of an augmented robot vary: give its seed, augment")
        return mujoco.MjModel.from_xml_string(model.xml())
    return augmented.build(augmented.draw(augment, vary_masses=vary_masses))
