"""Gymnasium environments of a lab: good ones, and some that jbench refuses."""

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit

EPISODE = 20
"""Control steps of an episode."""

NUMBERS = spaces.Box(-np.inf, np.inf, (2,), np.float64)


class Cart(gymnasium.Env):
    """A cart that a motor pushes; its reward is not bounded."""

    observation_space = spaces.Dict(
        {"cart": NUMBERS, "goal": spaces.Tuple([spaces.Box(-1, 1, (), np.float64)] * 2)}
    )
    action_space = spaces.Box(-2, 4, (1, 1), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state, self.made = self.np_random.uniform(-1, 1, 2), 0
        return self.observe(), {}

    def step(self, action):
        self.made += 1
        position, velocity = self.state
        velocity += 0.1 * action[0, 0]
        self.state = np.array([position + 0.1 * velocity, velocity])
        return self.observe(), self.reward(), self.has_fallen(), False, {}

    def observe(self):
        return {"cart": self.state.copy(), "goal": (0.25, -0.5)}

    def reward(self):
        return -10 * abs(float(self.state[0]))

    def has_fallen(self):
        return False


class Falls(Cart):
    def has_fallen(self):
        return self.made == 7


class Leaves(Cart):
    """Its episodes end where the cart leaves the rail, or by the time limit."""

    def has_fallen(self):
        return abs(float(self.state[0])) > 1


class Drifts(Leaves):
    """Its noise is not seeded, so that no episode repeats."""

    def step(self, action):
        self.state = self.state + 1e-3 * np.random.default_rng().uniform(-1, 1, 2)
        return super().step(action)


class Wakes(Cart):
    """Its first states are not seeded."""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = np.random.default_rng().uniform(-1, 1, 2)
        return self.observe(), {}


class HugeReward(Cart):
    def reward(self):
        return np.inf if self.made == 3 else 0.0


class Clocked(Cart):
    """It also observes the number of control steps that were made."""

    observation_space = spaces.Dict(
        {"cart": NUMBERS, "clock": spaces.Box(0, np.inf, (), np.float64)}
    )

    def observe(self):
        return {"cart": self.state.copy(), "clock": float(self.made)}


class Discrete(Cart):
    action_space = spaces.Discrete(3)


class Unbounded(Cart):
    action_space = spaces.Box(-np.inf, np.inf, (1,), np.float32)


class Pixels(Cart):
    observation_space = spaces.Box(0, 255, (8, 8, 3), np.uint8)


class ScaledPixels(Cart):
    observation_space = spaces.Dict(
        {"cart": NUMBERS, "eye": spaces.Box(0, 1, (3, 16, 20), np.float32)}
    )


class Counts(Cart):
    observation_space = spaces.Dict({"cart": NUMBERS, "gear": spaces.Discrete(4)})


def limited(kind):
    return lambda: TimeLimit(kind(), EPISODE)


cart, falls, leaves, drifts, wakes = map(limited, (Cart, Falls, Leaves, Drifts, Wakes))
clocked = limited(Clocked)
huge_reward, discrete, unbounded, pixels, scaled_pixels, counts = map(
    limited, (HugeReward, Discrete, Unbounded, Pixels, ScaledPixels, Counts)
)


def recorded():
    """The limit is within another wrapper."""
    return RecordEpisodeStatistics(TimeLimit(Cart(), EPISODE))


gymnasium.register("lab/Cart-v0", "tests.gym_tasks:Cart", max_episode_steps=EPISODE)


def falls_without_limit():
    return Falls()


def endless():
    return Cart()
