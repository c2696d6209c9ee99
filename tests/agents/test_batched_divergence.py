"""Tests that divergence of a seed is detected and does not affect other seeds."""

import math

import numpy as np
import pytest
import torch

from tests.agents.test_batched_engine import FEW, STEPS, build_engine, slow

SEEDS, DIVERGED = [0, 5, 3], 1
# A network of each algorithm, and what is reported when a weight of it is not finite.
POISONED = {
    "ddpg": ("critic", "critic_loss"),
    "td3": ("actor", "actions"),
    "sac": ("critic_targets 0", "critic_loss"),
    "ppo": ("critic", "policy_loss"),
}


def poison(engine, network):
    """Sets a weight of one seed's network to infinity; `network` is a path of attributes."""
    attribute = engine.learners[DIVERGED]
    for part in network.split():
        attribute = attribute[int(part)] if part.isdigit() else getattr(attribute, part)
    attribute.values[3] = math.inf


def trained(engine, algo, poisoned_at=None):
    """Trains agents, one of which may be poisoned; returns the returns and state of the last."""
    returns = []
    for ends in engine.learn(STEPS):
        if engine.control_steps == poisoned_at:
            poison(engine, POISONED[algo][0])
        returns.append(None if ends is None else ends.returns[2].tolist())
    return returns, engine.state(2)


@pytest.mark.parametrize(
    ("algo", "stacked"),
    [
        *(("ddpg", True), ("ppo", True), ("td3", False), ("sac", False)),
        *(slow("ddpg", False), slow("ppo", False), slow("td3", True), slow("sac", True)),
    ],
)
def test_diverged_seed_does_not_affect_others(algo, stacked, capfd):
    with build_engine(algo, SEEDS, stacked=stacked) as engine:
        returns, state = trained(engine, algo)
        assert engine.diverged == {}
    with build_engine(algo, SEEDS, stacked=stacked) as engine:
        returns_beside, state_beside = trained(engine, algo, poisoned_at=42)
        ((diverged, error),) = engine.diverged.items()
        assert (diverged, error.what) == (DIVERGED, POISONED[algo][1])
        actions = engine.act(np.zeros((3, 4, 16), np.float32))
    assert returns_beside == returns
    assert state_beside.scalars == state.scalars
    for name, tensor in state.tensors.items():
        assert torch.equal(state_beside.tensors[name], tensor), name
    assert np.abs(actions[DIVERGED]).max() == 0 < np.abs(actions[2]).min()
    # MuJoCo would print a warning about actions that are not finite.
    assert "WARNING" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("stacked", [False, slow(True)])
def test_diverged_features_are_detected_and_do_not_affect_others(stacked):
    states = []
    for poisoned in (False, True):
        with build_engine("td3", SEEDS, ofe=FEW, stacked=stacked) as engine:
            for _ in engine.learn(60):
                if poisoned and engine.control_steps == 59:
                    # The layer that predicts the next observation; the agent does not use it.
                    last = engine.learners[DIVERGED].features.layers[-1]
                    last.weight[0, 0] = math.inf
            engine.check_weights()
            states.append(engine.state(2).tensors)
    values = {"update": 24, "control_steps": 60, "what": "prediction_loss"}
    assert {n: e.summary for n, e in engine.diverged.items()} == {DIVERGED: {"diverged": values}}
    for name, tensor in states[0].items():
        assert torch.equal(states[1][name], tensor), name


def test_temperature_of_zero_is_not_divergence():
    # The logarithm, which is saved, is -inf.
    with build_engine("sac", SEEDS, changes={"ent_coef": 0.0}) as engine:
        list(engine.learn(60))
        engine.check_weights()
        assert engine.updates > 0
        assert engine.diverged == {}
