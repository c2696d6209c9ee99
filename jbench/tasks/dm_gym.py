"""The name in Minari datasets that were exported before one environment served every robot."""

from jbench.tasks.gym import RobotEnv as SuiteEnv

__all__ = ["SuiteEnv"]
