"""Tasks: robots, their observations, actions and rewards; everything that knows a robot.

Importing this package adds the domains `jitterbug` and `augmented_jitterbug` to the dm_control
suite, where dm_control is installed, and five environments each of `Jitterbug/…-v0` and
`AugmentedJitterbug/…-v0` to Gymnasium.
"""

import importlib.util
import warnings

from jbench.opengl import import_triton_before_mesa
from jbench.registration import register_environments


def _register_domains() -> None:
    """Adds the Jitterbug to dm_control's suite."""
    with warnings.catch_warnings():
        # dm_control looks for a display when it is imported; only rendering needs one.
        warnings.filterwarnings("ignore", message=".*DISPLAY", module="glfw")
        from jbench.tasks.jitterbug import domain
    domain.add_to_suite()


import_triton_before_mesa()

# dm-control needs labmaze, which has no wheel for Python 3.13 and later.
if importlib.util.find_spec("dm_control"):
    _register_domains()
register_environments()
