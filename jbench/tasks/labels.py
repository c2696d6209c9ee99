"""Observations in words."""

import math

import numpy as np
from numpy.typing import NDArray

from jbench.tasks.features import denormalize, split


def goal(task: str, observation: NDArray[np.floating]) -> str:
    """Describes the remaining distance and angle to the goal of an observation (dim(O),).

    Distances are horizontal. Numbers are padded with figure spaces to a fixed width.
    """
    physical = denormalize(task, np.asarray(observation, np.float64))
    by_name = split(task, physical)
    if task == "move_from_origin":
        return f"{_centimeters(by_name['position'])} from the origin"
    if task == "move_in_direction":
        speed = 100 * by_name["speed_in_target_frame"][0]
        return f"{padded(f'{speed:.1f}', 5)} cm/s as the target points"
    words = []
    if "target_in_jitterbug_frame" in by_name:
        words.append(f"target {_centimeters(by_name['target_in_jitterbug_frame'])} away")
    if "angle_to_target" in by_name:
        angle = math.degrees(by_name["angle_to_target"][0])
        side = "left" if angle > 0 else "right"
        words.append(f"turn {padded(f'{abs(angle):.0f}', 3)}° {side}")
    return ", ".join(words)


def _centimeters(vector: NDArray[np.float64]) -> str:
    """Returns the horizontal length of a vector (3 or more,) in meters."""
    return f"{padded(f'{100 * math.hypot(vector[0], vector[1]):.1f}', 4)} cm"


def padded(number: str, width: int) -> str:
    """Returns a number with figure spaces before it, which are as wide as digits."""
    return number.rjust(width, "\N{FIGURE SPACE}")
