"""Tests of the actions of what a caller trains."""

import gymnasium
import numpy as np
from stable_baselines3 import SAC
from torch import nn

from jbench.policies.acting import acting


def test_policy_of_stable_baselines3_acts_without_exploration():
    model = SAC(
        "MlpPolicy", gymnasium.make("jbench:Jitterbug/FaceDirection-v0"), buffer_size=1, seed=0
    )
    observations = np.random.default_rng(0).normal(size=(20, 16)).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    for actor in (model, model.policy, model.actor):
        with acting(actor, 1) as act:
            np.testing.assert_array_equal(act(observations), wanted)


def test_module_with_predict_of_its_own_is_called():
    class Constant(nn.Module):
        def forward(self, x):
            return x[:, :1] * 0 + 0.5

        def predict(self, x):
            raise AssertionError(x)

    with acting(Constant(), 1) as act:
        assert act(np.zeros((3, 16), np.float32)).tolist() == [[0.5]] * 3
