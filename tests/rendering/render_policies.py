"""A policy for the tests of rendering."""

import numpy as np

PAD = "\N{FIGURE SPACE}"


class Constant:
    """A constant action, of one motor or (actions,); records the observations."""

    def __init__(self, command=0.5, fails_at=None):
        self.command, self.fails_at = command, fails_at
        self.robots, self.observations = [], []

    def reset(self, robots):
        self.robots.append(robots)

    def act(self, batch):
        if self.fails_at == len(self.observations):
            raise KeyboardInterrupt
        self.observations.append(batch[0].copy())
        return np.tile(self.command, (len(batch), 1))
