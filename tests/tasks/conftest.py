"""Models of the plain robot."""

import mujoco
import pytest

from jbench.tasks.jitterbug import model
from jbench.tasks.jitterbug.robots import load_model


@pytest.fixture(scope="session")
def robot():
    """The robot that is simulated."""
    return load_model()


@pytest.fixture(scope="session")
def general():
    """The robot of the XML: MuJoCo searches for all geoms that touch."""
    return mujoco.MjModel.from_xml_string(model.xml())
