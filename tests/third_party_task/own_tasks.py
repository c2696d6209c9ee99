"""Tasks of a lab: factories of dm_env environments, a good one and some that jbench refuses."""

import dm_env
import numpy as np
from dm_env import specs


class Integrator(dm_env.Environment):
    """A point on a line that is pushed towards the origin; `random` seeds its start."""

    steps = 1000
    actions = specs.BoundedArray((2,), float, -2, 3)

    def __init__(self, random=None):
        self._random = np.random.RandomState(random)

    def observation_spec(self):
        return {"place": specs.Array((2, 2), float), "height": specs.Array((), float)}

    def action_spec(self):
        return self.actions

    def reset(self):
        self.place, self.made = self._random.uniform(-1, 1, (2, 2)), 0
        return dm_env.restart(self.observe())

    def step(self, action):
        self.made += 1
        self.place = 0.9 * self.place + 0.1 * action
        end = dm_env.truncation if self.made == self.steps else dm_env.transition
        return end(self.reward(), self.observe())

    def observe(self):
        return {"place": self.place, "height": self.place.sum()}

    def reward(self):
        return float(np.exp(-np.square(self.place).sum()))


class Counted(Integrator):
    opened = 0

    def __init__(self, random=None):
        super().__init__(random)
        Counted.opened += 1

    def close(self):
        Counted.opened -= 1


class Short(Integrator):
    steps = 20


class EndsEarly(Integrator):
    """Falls after 5 control steps."""

    def step(self, action):
        timestep = super().step(action)
        if self.made < 5:
            return timestep
        return dm_env.termination(timestep.reward, timestep.observation)


class WrongReward(Integrator):
    def reward(self):
        return 2 * super().reward()


class NotFinite(Integrator):
    def observe(self):
        return {"place": self.place, "height": np.nan if self.made == 3 else 0.0}


class ChangesSize(Integrator):
    def observe(self):
        return {"place": self.place, "height": np.zeros(1 + self.made // 4)}


class Unnamed(Integrator):
    def observation_spec(self):
        return specs.Array((5,), float)


class Integers(Integrator):
    actions = specs.DiscreteArray(3)


class Unbounded(Integrator):
    actions = specs.Array((2,), float)


class CountedUnbounded(Counted, Unbounded):
    """Is refused, and counts whether it is closed."""


class OneValue(Integrator):
    actions = specs.BoundedArray((2,), float, [-1, 0.5], [1, 0.5])


class Reordered(Integrator):
    """Its observations have the parts in another order than their specification."""

    def observe(self):
        return dict(reversed(super().observe().items()))


class LacksPart(Integrator):
    def observe(self):
        return {"place": self.place}


class SameNames(Integrator):
    """`place_0` is also the first value of `place`."""

    def observation_spec(self):
        return {"place": specs.Array((2, 2), float), "place_0": specs.Array((), float)}


class Rewarding(Integrator):
    """A column of its datasets would have the name of another one."""

    def observation_spec(self):
        return {"reward": specs.Array((), float)}


class Broken(Integrator):
    def step(self, action):
        raise OSError("no motor")


def unseeded():
    return Integrator()


def composed():
    made = Integrator()
    made.random_state = np.random.RandomState(0)  # as composer.Environment has it
    return made


def nothing():
    return None


number = 3
