"""The robot and what it must do.

Importing this package adds the domain `jitterbug` to the dm_control suite and the five
`Jitterbug/…-v0` environments to Gymnasium.
"""

from dm_control import suite

from jbench.tasks import gym, jitterbug


def _register_domain() -> None:
    """Adds the domain to the suite, and its tasks to the suite's lists of tasks."""
    suite._DOMAINS["jitterbug"] = jitterbug
    suite.ALL_TASKS = suite._get_tasks(tag=None)
    suite.BENCHMARKING = suite._get_tasks("benchmarking")
    suite.EASY = suite._get_tasks("easy")
    suite.HARD = suite._get_tasks("hard")
    suite.EXTRA = tuple(sorted(set(suite.ALL_TASKS) - set(suite.BENCHMARKING)))
    suite.REWARD_VIZ = tuple(sorted(set(suite.ALL_TASKS) - set(suite.NO_REWARD_VIZ)))
    suite.TASKS_BY_DOMAIN = suite._get_tasks_by_domain(suite.ALL_TASKS)


_register_domain()
gym.register_environments()
