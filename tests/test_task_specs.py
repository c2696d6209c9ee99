"""Tests of what is known of a task by its name."""

import math

from jbench.task_specs import highest_return


def test_highest_return_is_that_of_the_task():
    assert highest_return("move_to_pose") == highest_return("dmc:cheetah-run") == 1000
    assert highest_return("gym:Pendulum-v1") == math.inf
