"""The robot and its tasks.

Importing this package adds the domains `jitterbug` and `augmented_jitterbug` to the dm_control
suite, where dm_control is installed, and five environments each of `Jitterbug/…-v0` and
`AugmentedJitterbug/…-v0` to Gymnasium.
"""

import importlib.util
import warnings
from types import SimpleNamespace

from jbench.registration import register_environments


def _register_domains() -> None:
    with warnings.catch_warnings():
        # dm_control looks for a display when it is imported; only rendering needs one.
        warnings.filterwarnings("ignore", message=".*DISPLAY", module="glfw")
        from dm_control import suite
    from jbench.tasks import jitterbug

    suite._DOMAINS["jitterbug"] = jitterbug
    suite._DOMAINS["augmented_jitterbug"] = SimpleNamespace(SUITE=jitterbug.AUGMENTED_SUITE)
    suite.ALL_TASKS = suite._get_tasks(tag=None)
    suite.BENCHMARKING = suite._get_tasks("benchmarking")
    suite.EASY = suite._get_tasks("easy")
    suite.HARD = suite._get_tasks("hard")
    suite.EXTRA = tuple(sorted(set(suite.ALL_TASKS) - set(suite.BENCHMARKING)))
    suite.REWARD_VIZ = tuple(sorted(set(suite.ALL_TASKS) - set(suite.NO_REWARD_VIZ)))
    suite.TASKS_BY_DOMAIN = suite._get_tasks_by_domain(suite.ALL_TASKS)


# dm-control needs labmaze, which has no wheel for Python 3.13 and later.
if importlib.util.find_spec("dm_control"):
    _register_domains()
register_environments()
