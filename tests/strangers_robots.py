"""Robots of models (MJCF) that others wrote and packages contain, as tasks."""

from pathlib import Path

import dm_control
import gymnasium
import mujoco
import numpy as np
from gymnasium.wrappers import TimeLimit

KINOVA = Path(dm_control.__file__).parent / "third_party" / "kinova" / "jaco_arm.xml"
"""A description of Kinova's arm Jaco, which has six joints, and no actuators."""

EPISODE = 40
"""Control steps of an episode of the arm."""


class Arm(gymnasium.Env):
    """Brings the wrist of Kinova's arm to a random target; terminates where a joint is too fast."""

    observation_space = gymnasium.spaces.Dict(
        {
            "angles": gymnasium.spaces.Box(-np.inf, np.inf, (12,), np.float64),
            "rates": gymnasium.spaces.Box(-np.inf, np.inf, (6,), np.float64),
            "to_target": gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float64),
        }
    )
    action_space = gymnasium.spaces.Box(-30, 30, (6,), np.float64)  # Nm
    dt = 0.02

    def __init__(self):
        description = mujoco.MjSpec.from_file(str(KINOVA))
        for joint in description.joints:
            motor = description.add_actuator(name=joint.name, target=joint.name)
            motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        self.model = description.compile()
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = np.pi + self.np_random.uniform(-0.2, 0.2, 6)
        self.target = np.array([0, 0, 0.5]) + self.np_random.uniform(-0.3, 0.3, 3)
        mujoco.mj_forward(self.model, self.data)
        return self.observe(), {}

    def step(self, action):
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, 10)
        observation = self.observe()
        is_too_fast = bool(np.abs(self.data.qvel).max() > 1.5)
        distance = float(np.linalg.norm(observation["to_target"]))
        return observation, -distance, is_too_fast, False, {}

    def observe(self):
        angles = self.data.qpos
        wrist = self.data.site("wristsite").xpos
        return {
            "angles": np.concatenate([np.cos(angles), np.sin(angles)]),
            "rates": self.data.qvel.copy(),
            "to_target": self.target - wrist,
        }


def arm():
    return TimeLimit(Arm(), EPISODE)
