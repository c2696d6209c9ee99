"""Robots with odd specifications and observations, and robots whose episodes can't go on."""

from collections import OrderedDict

import numpy as np
from dm_control.mujoco import Physics
from dm_control.rl.control import Environment
from dm_control.suite.base import Task

from tests.third_party_task.own_tasks import Short

EPISODE = 20
"""Control steps of an episode."""

MODEL = """
<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
  </worldbody>
  <actuator><motor joint="x" gear="{gear}" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


class Observed(Task):
    """A mass on a rail; `observe` returns the parts of its observation."""

    def __init__(self, observe):
        super().__init__()
        self._observe = observe

    def get_observation(self, physics):
        return OrderedDict(self._observe(physics.data))

    def get_reward(self, physics):
        return 0.5


def _made(observe, gear=3.0):
    physics = Physics.from_xml_string(MODEL.format(gear=gear))
    return Environment(physics, Observed(observe), time_limit=EPISODE * 0.01, control_timestep=0.01)


def without_sensors():
    """A part of its observation has no values."""
    return _made(lambda data: {"q": data.qpos.copy(), "sensors": data.sensordata.copy()})


def scalars():
    """A float and a list are parts of its observation."""
    return _made(lambda data: {"q": float(data.qpos[0]), "v": [float(data.qvel[0])]})


def nothing_observed():
    return _made(lambda data: {"sensors": data.sensordata.copy()})


def drawn():
    """A robot that also observes a picture of scaled numbers."""
    return _made(lambda data: {"q": data.qpos.copy(), "eye": np.zeros((16, 16, 3))})


def two_cases():
    """Two parts of its observation differ in upper and lower case only."""
    return _made(lambda data: {"q": data.qpos.copy(), "Q": data.qvel.copy()})


def diverging():
    """Its physics diverges while it is pushed."""
    return _made(lambda data: {"v": np.tanh(data.qvel / 1e9)}, gear=1e11)


def talkative():
    """Prints whenever it is observed."""

    def observe(data):
        print("observed")
        return {"v": data.qvel.copy()}

    return _made(observe)


class MadeAgain(Short):
    """Has a physics, and is made again for each episode."""

    physics = Physics.from_xml_string(MODEL.format(gear=1))


class NoObservationSpec(Short):
    def observation_spec(self):
        raise NotImplementedError("later")


class NoActionSpec(Short):
    def action_spec(self):
        raise KeyError("nope")


class FailsToClose(Short):
    """Is made again for each episode, and closed before."""

    def close(self):
        raise OSError("the simulator is gone")


class Fragile(Short):
    """Every fifth episode, on average, breaks at its 7th control step."""

    error = OSError

    def reset(self):
        timestep = super().reset()
        self.is_broken = self._random.uniform() < 0.2
        return timestep

    def step(self, action):
        if self.is_broken and self.made == 6:
            raise self.error("a leg\nbroke")
        return super().step(action)


class Faulty(Fragile):
    """An error of its numbers breaks its episodes."""

    error = ArithmeticError


class Hungry(Fragile):
    """A lack of memory breaks its episodes."""

    error = MemoryError


class NeedsFinite(Short):
    """Raises an error for an action that is not finite, as dm_control does."""

    def step(self, action):
        if not np.isfinite(action).all():
            raise ValueError("not a finite action")
        return super().step(action)


class OtherSimulator(Short):
    """Its physics is not MuJoCo's."""

    class physics:  # noqa: N801 - an attribute
        model = "made of wood"


class TimestepInText(Short):
    def control_timestep(self):
        return "0.01"


class Nested(Short):
    """Its observation is a dictionary in a dictionary."""

    def observation_spec(self):
        return {"arm": super().observation_spec()}


class BeginsAgain(Short):
    """Begins an episode at each control step."""

    episode_steps = EPISODE

    def step(self, action):
        return self.reset()
