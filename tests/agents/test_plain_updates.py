"""Tests of the update rules, against autograd, for settings that stable-baselines3 lacks, too."""

import math

import pytest
import torch

from jbench.agents.batched.layers import Affine
from jbench.agents.batched.ppo import Transitions
from jbench.agents.batched.replay import Batch
from jbench.settings.algorithms import SETTINGS, algorithm_settings
from tests.agents.batched_oracle import SIZE, build_learner, build_settings, linear_layers
from tests.agents.plain_ddpg import PlainDDPG
from tests.agents.plain_ppo import PlainPPO
from tests.agents.plain_sac import PlainSAC
from tests.agents.plain_td3 import PlainTD3
from tests.matrices import diagonal

SCRIPT = {algo: SETTINGS[algo].bases["script"] for algo in ("ddpg", "ppo", "td3")}
ACTIONS = (1, 6, 21)
# The plain version of each off-policy rule, and its networks.
PLAIN = {
    "ddpg": (PlainDDPG, ["actor", "critic", "actor_target", "critic_target"]),
    "td3": (PlainTD3, ["actor", "critics", "actor_target", "critic_targets"]),
    "sac": (PlainSAC, ["actor", "critics", "critic_targets"]),
}


def ppo_layers(learner, plain):
    """Pairs of layers of the learner and of the plain version."""
    (*policy, mean), (*value, last) = learner.actor.layers, learner.critic.layers
    yield from zip(policy, linear_layers(plain.policy_layers), strict=True)
    yield from zip(value, linear_layers(plain.value_layers), strict=True)
    # A network shared by policy and value has both outputs.
    actions = learner.action_size
    yield Affine(mean.weight[:, :actions], mean.bias[:actions]), plain.mean
    yield Affine(last.weight[:, -1:], last.bias[-1:]), plain.value


def paired_layers(algo, learner, plain):
    """Pairs of layers of the learner's networks and of the plain version."""
    for name in PLAIN[algo][1]:
        network = getattr(learner, name)
        networks = network if isinstance(network, list) else [network]
        layers = [layer for network in networks for layer in network.layers]
        yield from zip(layers, linear_layers(getattr(plain, name)), strict=True)


def copy_parameters(layers):
    for ours, plain in layers:
        plain.weight.data.copy_(ours.weight.mT)
        plain.bias.data.copy_(ours.bias)


def assert_equal_parameters(layers, bound=1e-10):
    for ours, plain in layers:
        torch.testing.assert_close(ours.weight.mT, plain.weight.data, rtol=0, atol=bound)
        torch.testing.assert_close(ours.bias, plain.bias.data, rtol=0, atol=bound)


def minibatch(learner, random, rows=40):
    """Transitions with old values near the current ones, so that some are clipped."""

    def normal(width=1):
        return torch.randn(rows, width, generator=random, dtype=torch.float64)

    observations = normal(SIZE)
    values = learner.value(observations) + 0.15 * normal()
    returns = values + 0.3 * normal()
    actions = normal(learner.action_size)
    likelihoods = -1.4 * learner.action_size + 0.2 * normal()
    columns = [observations, actions, likelihoods, values, normal(), returns, normal()]
    return Transitions(torch.cat(columns, dim=-1), learner.action_size)


def transitions(random, actions=1, noise=0):
    def normal(width):
        return torch.randn(30, width, generator=random, dtype=torch.float64)

    width = SIZE + actions + 1
    return Batch(normal(width), normal(width), 0.99 + 0 * normal(1), normal(noise), actions)


# With a large tau, the targets influence the updates early.
FAST = {"tau": 0.1}
CASES = [
    ("ppo", {}),
    ("ppo", {"shared_layers": True}),
    ("ppo", {"shared_layers": True, "hidden_layers": [16]}),
    ("ppo", {"value_loss": "max", "clip_range_vf": 0.1}),
    ("ppo", {"value_loss": "max", "clip_range_vf": None}),
    ("ppo", SCRIPT["ppo"]),
    ("ddpg", FAST),
    ("ddpg", {**FAST, "action_layer": 1}),
    ("ddpg", {**FAST, "action_layer": 1, "hidden_layers": [16]}),
    ("ddpg", {**FAST, "action_layer": 1, "hidden_layers": [31, 9, 16]}),
    ("ddpg", {**FAST, "gradients_first": True}),
    ("ddpg", {**FAST, **SCRIPT["ddpg"]}),
    ("td3", FAST),
    # The target entropy is minus the size of an action.
    ("sac", {**FAST, "target_entropy": "auto"}),
]


@pytest.mark.parametrize(("case", "actions"), diagonal(CASES, ACTIONS))
def test_updates_equal_autograd(case, actions):
    algo, changes = case
    settings = build_settings(algo, **changes)
    _, learner = build_learner(algo, settings, torch.float64, action_size=actions)
    learner.initialize(torch.Generator().manual_seed(1))
    random = torch.Generator().manual_seed(2)
    if algo == "ppo":
        plain = PlainPPO(settings, SIZE, actions)
        layers = [*ppo_layers(learner, plain)]
    else:
        plain = PLAIN[algo][0](settings, SIZE, actions)
        layers = [*paired_layers(algo, learner, plain)]
    copy_parameters(layers)
    for number in range(1, 31):
        if algo == "ppo":
            batch = minibatch(learner, random)
        else:
            batch = transitions(random, actions, learner.noise_per_transition)
        delayed = [number % settings.policy_delay == 0] if algo == "td3" else []
        # An update of the learner overwrites the actions of its batch.
        plain.update(batch, *delayed)
        learner.update(batch, *delayed)
    assert_equal_parameters(layers)
    for name in ("log_sigma", "log_temperature"):
        if hasattr(learner, name):
            expected = getattr(plain, name).data
            torch.testing.assert_close(getattr(learner, name), expected, rtol=0, atol=1e-10)


def test_log_sigma_of_sac_beyond_its_bounds_has_no_gradient():
    settings = build_settings("sac", **FAST)
    _, learner = build_learner("sac", settings, torch.float64, action_size=6)
    learner.initialize(torch.Generator().manual_seed(1))
    log_sigma = learner.actor.layers[-1].bias[6:]
    log_sigma[:3] = 5.0  # the upper bound is 2
    plain = PlainSAC(settings, SIZE, 6)
    layers = [*paired_layers("sac", learner, plain)]
    copy_parameters(layers)
    batch = transitions(torch.Generator().manual_seed(2), 6, learner.noise_per_transition)
    plain.update(batch)
    learner.update(batch)
    assert_equal_parameters(layers)
    assert (log_sigma == 5.0).tolist() == [True] * 3 + [False] * 3


def first_layers(algo, **changes):
    settings = algorithm_settings(algo, overrides={"hidden_layers": [200, 100], **changes})
    _, learner = build_learner(algo, settings)
    learner.initialize(torch.Generator().manual_seed(0))
    return learner


def assert_uniform(weight, bound):
    assert 0.95 * bound < weight.abs().max() <= bound
    # The standard deviation of U(-b, b) is b / sqrt(3).
    assert weight.std().item() == pytest.approx(bound / math.sqrt(3), rel=0.1)


@pytest.mark.parametrize("algo", ["ddpg", "td3"])
def test_script_settings_have_glorot_initialization(algo):
    learner = first_layers(algo, **SCRIPT[algo])
    critics = [learner.critic] if algo == "ddpg" else learner.critics
    for network in (learner.actor, *critics):
        *hidden, last = network.layers
        for weight, _ in hidden:
            assert_uniform(weight, math.sqrt(6 / sum(weight.shape)))
        bound = 3e-3 if algo == "ddpg" else math.sqrt(6 / sum(last.weight.shape))
        assert_uniform(last.weight, bound)
        assert not any(bias.any() for _, bias in network.layers)


def test_script_ddpg_has_initial_actions_near_zero():
    learner = first_layers("ddpg", **SCRIPT["ddpg"])
    inputs = [weight.shape[0] for weight, _ in learner.critic.layers]
    assert inputs == [16, 201, 100]
    # The usual initial weights give actions of 0.1 to 0.3.
    observations = torch.randn(50, SIZE, generator=torch.Generator().manual_seed(1))
    assert learner.act(observations).abs().max() < 0.05


def test_last_layer_bound_limits_only_last_layer():
    learner = first_layers("ddpg", last_layer_bound=0.01)
    for network in (learner.actor, learner.critic):
        *_, hidden, last = network.layers
        assert_uniform(hidden.weight, 1 / math.sqrt(200))
        assert_uniform(last.weight, 0.01)
        assert 0 < last.bias.abs() <= 0.01


def test_shared_layers_have_orthogonal_initialization():
    learner = first_layers("ppo", shared_layers=True)
    assert learner.actor is learner.critic
    *hidden, last = (weight for weight, _ in learner.actor.layers)
    for weight in hidden:
        short = weight if weight.shape[0] < weight.shape[1] else weight.mT
        torch.testing.assert_close(short @ short.mT, 2 * torch.eye(len(short)), rtol=0, atol=1e-5)
    torch.testing.assert_close(last.norm(dim=0), torch.tensor([0.01, 1.0]))
