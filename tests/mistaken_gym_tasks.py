"""Gymnasium environments of a lab with mistakes, or with wrappers that do not suit training."""

import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit

from tests.gym_tasks import EPISODE, Cart, limited


class OlderStep(Cart):
    """Returns what the older library Gym did."""

    def step(self, action):
        return super().step(action)[:4]


class OlderReset(Cart):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)[0]


class NoReward(Cart):
    def reward(self):
        return None


class RewardInArray(Cart):
    def reward(self):
        return np.array([0.5])


class LargeReward(Cart):
    def reward(self):
        return -1e30


class LargeObservation(Cart):
    def observe(self):
        return {"cart": 1e60 * self.state, "goal": (0.25, -0.5)}


class NothingObserved(Cart):
    observation_space = spaces.Box(-1, 1, (2,), np.float64)

    def observe(self):
        return None


class ListForTuple(Cart):
    """Returns a list of the parts of a Tuple, and more than its space has."""

    def observe(self):
        return {"cart": self.state.copy(), "goal": [0.25, -0.5], "speed": 1.0}


older_step, older_reset, no_reward, reward_in_array = map(
    limited, (OlderStep, OlderReset, NoReward, RewardInArray)
)
large_reward, large_observation, nothing_observed, list_for_tuple = map(
    limited, (LargeReward, LargeObservation, NothingObserved, ListForTuple)
)


def unlicensed():
    raise RuntimeError("no license\nfor the simulator")


def normalized_reward():
    return TimeLimit(NormalizeReward(Cart()), EPISODE)


class Place(Cart):
    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def observe(self):
        return self.state.copy()


def normalized_observation():
    return NormalizeObservation(TimeLimit(Place(), EPISODE))
