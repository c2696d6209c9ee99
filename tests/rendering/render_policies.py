"""Policies and readers that the tests of rendering share."""

import numpy as np

PAD = "\N{FIGURE SPACE}"


class Constant:
    """One motor command, and a record of what it was asked."""

    def __init__(self, command=0.5, fails_at=None):
        self.command, self.fails_at = command, fails_at
        self.robots, self.asked = [], []

    def reset(self, robots):
        self.robots.append(robots)

    def act(self, observations):
        if self.fails_at == len(self.asked):
            raise KeyboardInterrupt
        self.asked.append(observations[0].copy())
        return np.full((len(observations), 1), self.command)
