"""Gymnasium environments of a lab with mistakes, or with wrappers that do not suit training."""

import signal
import sys

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit

from tests.gym_tasks import EPISODE, NUMBERS, Cart, Leaves, limited


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


class SwapsSizes(Cart):
    """Two parts of its observation change their sizes, and their sum stays."""

    observation_space = spaces.Dict(
        {"a": spaces.Box(-9, 9, (2,), np.float64), "b": spaces.Box(-9, 9, (1,), np.float64)}
    )

    def observe(self):
        size = 2 if self.made < 3 else 1
        return {"a": np.zeros(size), "b": np.zeros(3 - size)}


class NameTwice(Cart):
    """Two parts of its observation have one name."""

    observation_space = spaces.Dict(
        {"cart": spaces.Dict({"goal": NUMBERS}), "cart_goal": spaces.Box(-1, 1, (2,), np.float32)}
    )


class Quits(Cart):
    """Its simulator ends the process at the third control step."""

    def reward(self):
        return sys.exit() if self.made == 3 else 0.0


class QuitsAtReset(Cart):
    def reset(self, *, seed=None, options=None):
        sys.exit("no license")


class FailsToClose(Cart):
    """Its simulator is gone when it is closed."""

    closed = 0

    def close(self):
        FailsToClose.closed += 1
        raise OSError("the simulator\nis gone")


class FailsToClosePixels(FailsToClose):
    observation_space = spaces.Box(0, 255, (8, 8, 3), np.uint8)


class QuitsAtClose(Cart):
    def close(self):
        sys.exit("no license")


class IsStoppedAtClose(Cart):
    """Raises what Ctrl-C does in a process that ignores Ctrl-C, such as a worker."""

    def close(self):
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            raise KeyboardInterrupt


class TruncatesItself(Cart):
    """Truncates its episodes; the length of each follows from its seed."""

    lengths = {0: 8}  # noqa: RUF012
    other_length = 8

    def reset(self, *, seed=None, options=None):
        self.length = self.lengths.get(seed, self.other_length)
        return super().reset(seed=seed)

    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, self.made == self.length, info


class GoesOn(TruncatesItself):
    other_length = 12


class StopsEarly(TruncatesItself):
    lengths = {0: 12}  # noqa: RUF012


class SeldomStopsEarly(TruncatesItself):
    """Its episode of random actions is as long as the one that is measured."""

    lengths = {0: 12, int(np.random.default_rng(0).integers(2**32)): 12}  # noqa: RUF012


class LeavesArea(Cart):
    """Truncates its episodes where the cart leaves the rail."""

    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, abs(float(self.state[0])) > 1, info


gymnasium.register("lab/Endless-v0", "tests.gym_tasks:Cart")

fails_to_close, fails_to_close_pixels, quits_at_close, is_stopped_at_close = map(
    limited, (FailsToClose, FailsToClosePixels, QuitsAtClose, IsStoppedAtClose)
)
swaps_sizes, name_twice, quits, quits_at_reset, leaves_area = map(
    limited, (SwapsSizes, NameTwice, Quits, QuitsAtReset, LeavesArea)
)
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


class Sequence(Cart):
    observation_space = spaces.Sequence(NUMBERS)


class ForgottenTime(Cart):
    @property
    def dt(self):
        raise RuntimeError("no clock")


class ForgottenModel(Cart):
    @property
    def model(self):
        raise RuntimeError("no model")


sequence, forgotten_time, forgotten_model = map(limited, (Sequence, ForgottenTime, ForgottenModel))

_only_one = TimeLimit(Cart(), EPISODE)


def same_again():
    return _only_one


def two_limits():
    return TimeLimit(TimeLimit(Cart(), EPISODE), 1500)


def far_limit():
    """Its episodes end long before their time limit."""
    return TimeLimit(Leaves(), 10**10)


class Rebuilt(Cart):
    """Makes its model of MuJoCo again at each reset."""

    def __init__(self):
        self.build()

    def build(self):
        body = "<body><geom size='.1'/></body>"
        self.model = mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody>{body}</worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed=None, options=None):
        self.build()
        return super().reset(seed=seed, options=options)


rebuilt = limited(Rebuilt)
