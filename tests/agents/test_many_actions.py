"""Tests of engines on robots with several motors: independent seeds, resuming, and policies."""

import numpy as np
import pytest
import torch
from torch import nn

import jbench
from jbench.errors import RequestError, WorkError
from jbench.settings.algorithms import ALGORITHMS
from tests.agents.small_rules import TD3, TD3_SETTINGS, TQC, TQC_SETTINGS
from tests.agents.test_batched_engine import (
    FEW,
    LENGTH,
    MANY,
    SCRIPTS,
    assert_continues,
    assert_independent,
    assert_policies_equal_agents,
    build_engine,
    short_engine,
    slow,
)
from tests.agents.test_plugin_engine import RandomAgent, returns
from tests.agents.test_plugin_engine import build_engine as plugin_engine

TASK, ACTIONS = "dmc:cheetah-run", 6
CHEETAH = {"task": TASK}
SWIMMER = {"task": "dmc:swimmer-swimmer6"}  # 5 motors; its target is part of the model
STEPS = 120  # control steps after which rollouts and episodes end, with all settings here


def learn(engine, steps):
    """Trains for this many control steps, also if a rollout is not complete then."""
    for _ in engine.learn(steps):
        if engine.control_steps == steps:
            return


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, CHEETAH) for algo in ALGORITHMS),
        ("ddpg", {**SWIMMER, **SCRIPTS["ddpg"], "environments": 2}),
        ("sac", {**CHEETAH, "ofe": FEW}),
        slow("td3", {**CHEETAH, "ofe": MANY}),
        slow("ppo", {**SWIMMER, "changes": {"shared_layers": True}}),
    ],
)
def test_seed_is_independent_of_other_seeds_bit_for_bit(algo, options):
    assert_independent(lambda seeds: build_engine(algo, seeds, **options), STEPS)


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in ALGORITHMS),
        ("td3", {"changes": {"action_noise": "ornstein-uhlenbeck"}}),
        slow("sac", {"ofe": MANY, "environments": 2}),
    ],
)
def test_engine_restored_between_episodes_continues_bit_for_bit(algo, options):
    # After two or four episodes, and an incomplete rollout of PPO and TD3.
    assert_continues(
        lambda seeds: build_engine(algo, seeds, **SWIMMER, **options), 4 * LENGTH, STEPS
    )


def test_state_within_an_episode_is_refused():
    with build_engine("td3", [0], **CHEETAH) as engine:
        next(engine.learn(LENGTH))
        with pytest.raises(
            WorkError, match="dmc:cheetah-run has a state between two episodes only"
        ):
            engine.state(0)


def test_each_motor_explores_by_itself():
    changes = {"learning_starts": 1000, "buffer_size": 1000}
    for uniform, deviation in ((True, 3**-0.5), (False, 0.3)):
        warmup = {**changes, "uniform_warmup": uniform, "noise_sigma": 0.0 if uniform else 0.3}
        with build_engine("td3", [0], **CHEETAH, changes=warmup) as engine:
            learn(engine, 10 * LENGTH)
            rows = engine.replay.rows_since(0)[0]
        # The last row of an episode has no action.
        actions = rows.view(10, LENGTH + 1, -1)[:, :-1, 17:-1].reshape(-1, ACTIONS).numpy()
        # Without correlation, the largest of 15 correlations of 200 samples is about 0.2.
        correlations = np.corrcoef(actions.T) - np.eye(ACTIONS)
        assert abs(correlations).max() < 0.35
        assert actions.std(axis=0) == pytest.approx([deviation] * ACTIONS, rel=0.2)


@pytest.mark.parametrize(("rule", "settings"), [(TQC, TQC_SETTINGS), slow(TD3, TD3_SETTINGS)])
def test_rule_of_another_package_moves_all_motors(rule, settings):
    assert_independent(lambda seeds: short_engine(rule, settings, TASK, seeds), STEPS)
    with short_engine(rule, settings, TASK, [3, 4]) as engine:
        actions = assert_policies_equal_agents(engine)
    assert np.ptp(actions, axis=-1).min() > 0


class AllMotors(RandomAgent):
    """Has an action for each motor."""

    def __init__(self, settings, environment, seed, device):
        super().__init__(settings, environment, seed, device)
        sizes = environment.observation_size, environment.action_size
        self.actor = nn.Sequential(nn.Linear(*sizes), nn.Tanh())
        self.optimizer = torch.optim.Adam(self.actor.parameters(), lr=0.01)

    def explore(self, observations):
        actions = self.act(observations)
        return actions + torch.randn(actions.shape).numpy()


def test_agent_of_another_package_moves_all_motors():
    with plugin_engine(AllMotors, TASK) as whole:
        list(whole.learn(40))
        state = whole.state(0)
        expected = returns(whole, 80)
        assert whole._agent.transitions[-1].actions.shape == (2, ACTIONS)
        assert whole.act(np.ones((1, 5, 17), np.float32)).shape == (1, 5, ACTIONS)
    with plugin_engine(AllMotors, TASK) as resumed:
        resumed.restore([state])
        assert returns(resumed, 80) == expected


def test_agent_for_one_motor_is_refused_before_training():
    class Unaware(jbench.Agent):
        def __init__(self, settings, environment, seed, device):
            pass

        def explore(self, observations):
            return np.zeros((len(observations), 1))

        act, learn = explore, None

    with (
        plugin_engine(Unaware, TASK) as engine,
        pytest.raises(WorkError, match=r"returned the shape \(2, 1\) .* return actions \(2, 6\)"),
    ):
        next(engine.learn(10))
    with pytest.raises(RequestError, match="1 output, not 17 and 6"):
        plugin_engine(RandomAgent, TASK)
