"""Update rules of other packages: their updates, independent seeds, resuming, and refusals."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import sb3_contrib
import torch
from stable_baselines3.common import policies
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

import jbench
from benchmarks.rules import TD3, mlp
from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.learner import LOSS_SUMS
from jbench.agents.batched.make import make_engine
from jbench.agents.batched.rule import Rule, made
from jbench.agents.batched.tensors import Tensors
from jbench.errors import WorkError
from jbench.policies.copied import UnsupportedPolicyError
from jbench.tasks.gym import JitterbugEnv
from tests.agents.batched_oracle import (
    SIZE,
    fill,
    learners_of,
    next_batch,
    settings_of,
    transitions,
)
from tests.agents.test_batched_engine import LENGTH, STEPS, assert_same, round_trip, trajectory

PAGE = (Path(__file__).parents[2] / "docs" / "your-own-rule.md").read_text()
SMALL = {"hidden_layers": (24, 20), "batch_size": 16, "learning_rate": 1e-3, "buffer_size": 70}
SCHEDULE = {"train_freq": 10, "gradient_steps": 5, "learning_starts": 20}
TD3_SETTINGS = TD3.Settings(**SMALL, **SCHEDULE)
PRECISION = {torch.float64: 1e-10, torch.float32: 2e-6}


def rule_of_the_page():
    names = {}
    exec(re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1], names)  # noqa: S102
    return names["TQC"]


TQC = rule_of_the_page()


class REDQ(TD3):
    """TD3 with targets of a random subset of critics, and an actor that learns from all."""

    delayed = ()

    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.critics = nn.ModuleList(mlp(observation_size + 1, 8, 1) for _ in range(4))
        self.noise_per_transition = len(self.critics)

    def values(self, critics, observations, actions):
        inputs = torch.cat([observations, actions], dim=-1)
        return torch.stack([critic(inputs) for critic in critics])

    def critic_loss(self, batch):
        following = batch.next_observations, self.actor_target(batch.next_observations).tanh()
        subset = batch.noise[0].argsort()[:2]
        next_values = self.values(self.critics_target, *following)[subset].amin(dim=0)
        targets = batch.rewards + batch.discounts * next_values
        values = self.values(self.critics, batch.observations, batch.actions)
        return (values - targets).square().mean(dim=1).sum()

    def actor_loss(self, batch):
        return -self.values(self.critics, batch.observations, self.act(batch.observations)).mean()


TQC_SETTINGS = TQC.Settings(**SMALL, **SCHEDULE, critics=3, quantiles=5, dropped=1)
RULES = pytest.mark.parametrize(
    ("rule", "settings"), [(TD3, TD3_SETTINGS), (TQC, TQC_SETTINGS)], ids=["td3", "tqc"]
)


def learners(rule, settings, dtype=torch.float32, seeds=1):
    """Tensors of some seeds, a learner per seed, and a learner of the stack."""
    tensors = Tensors(seeds, dtype)
    views = [tensors.stacked_view(), *(tensors.seed_view(seed) for seed in range(seeds))]
    make = partial(AutogradLearner, settings, SIZE, rule=made(rule, settings, SIZE))
    stack, *each = (make(view) for view in views)
    for seed, learner in enumerate(each):
        learner.initialize(torch.Generator().manual_seed(seed))
    return tensors, each, stack


def batches(rule, count, dtype=torch.float64, seeds=()):
    """Random minibatches as tuples of tensors."""
    random = torch.Generator().manual_seed(1)
    for _ in range(count):
        widths = (SIZE + 2, SIZE + 2, 1, rule.noise_per_transition)
        yield [torch.randn(*seeds, 32, width, generator=random, dtype=dtype) for width in widths]


def by_hand(learner):
    """Parameters of jbench's own TD3 by the names of the rule."""
    networks = {
        "actor": learner.actor,
        "actor_target": learner.actor_target,
        **{f"critics.{i}": net for i, net in enumerate(learner.critics.networks)},
        **{f"critics_target.{i}": net for i, net in enumerate(learner.critic_targets.networks)},
    }
    return {
        f"{name}.{2 * i}.{kind}": values
        for name, network in networks.items()
        for i, layer in enumerate(network.layers)
        for kind, values in (("weight", layer.weight.mT), ("bias", layer.bias))
    }


def mean_losses(learner, tensors):
    sums, counts = tensors.saved[LOSS_SUMS][0].unbind(dim=-1)
    return dict(zip(learner.losses, (sums / counts).tolist(), strict=True))


@pytest.mark.parametrize("dtype", PRECISION, ids=str)
def test_td3_as_a_rule_equals_the_gradients_by_hand(dtype):
    settings = settings_of("td3")
    own_tensors, (own,), _ = learners_of("td3", settings, dtype)
    tensors, (learner,), _ = learners(TD3, settings, dtype)
    own.initialize(torch.Generator().manual_seed(3))
    for name, values in by_hand(own).items():
        learner._parameters[name].copy_(values)
    first = by_hand(own)["actor.0.weight"].clone()
    for update, numbers in enumerate(batches(TD3, 100, dtype), 1):
        for each in (own, learner):
            delayed = each.is_delayed_update(update, 0)
            each.reset_losses([delayed])
            each.update(Batch(*(part.clone() for part in numbers)), delayed)
        if update in (1, 10, 100):
            expected = by_hand(own)
            assert learner._parameters.keys() == expected.keys()
            for name, values in expected.items():
                torch.testing.assert_close(
                    learner._parameters[name], values, rtol=0, atol=PRECISION[dtype], msg=name
                )
            if update > 1:
                expected = pytest.approx(mean_losses(own, own_tensors), rel=1e-4)
                assert mean_losses(learner, tensors) == expected
    assert (by_hand(own)["actor.0.weight"] - first).abs().max() > 0.01


@pytest.mark.parametrize(
    ("rule", "settings"), [(TD3, TD3_SETTINGS), (TQC, TQC_SETTINGS), (REDQ, TD3_SETTINGS)]
)
def test_a_stack_is_updated_as_each_seed_alone(rule, settings):
    (alone, each, _), (together, _, stack) = (
        learners(rule, settings, torch.float64, seeds=3) for _ in range(2)
    )
    assert not torch.equal(alone.saved["rule.actor"][0], alone.saved["rule.actor"][1])
    for update, numbers in enumerate(batches(stack, 6, seeds=(3,)), 1):
        delayed = stack.is_delayed_update(update, 0)
        for seed, learner in enumerate(each):
            learner.update(Batch(*(part[seed] for part in numbers)), delayed)
        stack.update(Batch(*numbers), delayed)
    assert alone.saved.keys() == together.saved.keys()
    for name, saved in alone.saved.items():
        torch.testing.assert_close(together.saved[name], saved, rtol=0, atol=1e-10)
    observations = torch.randn(3, 5, SIZE, dtype=torch.float64)
    expected = torch.stack([one.act(seen) for one, seen in zip(each, observations, strict=True)])
    torch.testing.assert_close(stack.act(observations), expected)


def engine_of(rule, settings, seeds, **options):
    options = {"device": "cpu", "episode_steps": LENGTH} | options
    return make_engine(rule, settings, "face_direction", seeds, **options)


@pytest.mark.parametrize("options", [{}, {"environments": 2, "time_limit": "terminal"}])
@RULES
def test_a_seed_does_not_depend_on_other_seeds_bit_for_bit(rule, settings, options):
    with (
        engine_of(rule, settings, [7, 0, 3], **options) as together,
        engine_of(rule, settings, [3], **options) as alone,
    ):
        torch.randn(3)  # the global generator is not used
        among = trajectory(together, 2)
        assert_same(trajectory(alone, 0), among)
    assert set(among[2][-1]) == {"critic_loss", "actor_loss"}


@pytest.mark.parametrize("stacked", [False, True])
@RULES
def test_a_restored_engine_continues_with_the_same_bits(rule, settings, stacked):
    options = {"stacked": stacked}
    with engine_of(rule, settings, [0, 4], **options) as whole:
        for _ in whole.learn(STEPS):
            if whole.control_steps == 57:
                states = [round_trip(whole.state(index)) for index in range(2)]
                rows, row = [whole.replay_rows(i).clone() for i in range(2)], whole.replay.row
        expected = [whole.state(index) for index in range(2)]
    with engine_of(rule, settings, [0, 4], **options) as resumed:
        for index in range(2):
            resumed.restore_rows(index, rows[index], row)
        resumed.restore(states)
        assert resumed.control_steps == 57
        for _ in resumed.learn(STEPS):
            pass
        for index in range(2):
            tensors, scalars = resumed.state(index)
            assert json.dumps(scalars) == json.dumps(expected[index].scalars)
            for name, values in expected[index].tensors.items():
                assert torch.equal(tensors[name], values), name


@RULES
def test_the_kept_policy_acts_like_the_agent_and_can_be_loaded(rule, settings):
    observations = np.random.default_rng(0).normal(size=(1, 10, SIZE)).astype(np.float32)
    with (
        engine_of(rule, settings, [0]) as engine,
        engine_of(rule, settings, [9]) as other,
        engine_of(rule, settings.model_copy(update={"hidden_layers": (8,)}), [0]) as smaller,
    ):
        for _ in engine.learn(60):
            pass
        kept = engine.policy(0)
        acted = engine.act(observations)
        np.testing.assert_allclose(kept.act(observations[0]), acted[0], atol=2e-6)
        assert not np.array_equal(other.act(observations), acted)
        other.load_policy(0, kept, 60)
        np.testing.assert_array_equal(other.act(observations), acted)
        with pytest.raises(ValueError, match="its layers are not those of its settings"):
            smaller.load_policy(0, kept, 60)


def test_a_seed_that_diverges_does_not_affect_the_others():
    states = []
    for poisoned in (False, True):
        with engine_of(TD3, TD3_SETTINGS, [0, 5]) as engine:
            if poisoned:
                engine._team.each[1]._parameters["critics.0.2.weight"][3, 4] = torch.inf
            for _ in engine.learn(STEPS):
                pass
            states.append(engine.state(0).tensors)
            assert {seed: found.what for seed, found in engine.diverged.items()} == (
                {1: "critic_loss"} if poisoned else {}
            )
    for name, values in states[0].items():
        assert torch.equal(values, states[1][name])


def oracle_of_tqc(settings, dtype, monkeypatch):
    """sb3-contrib's TQC with the settings of the page's rule."""
    monkeypatch.setattr(policies, "preprocess_obs", lambda observations, *_, **__: observations)
    layers = list(settings.hidden_layers)
    agent = sb3_contrib.TQC(
        "MlpPolicy",
        DummyVecEnv([lambda: JitterbugEnv("face_direction")]),
        policy_kwargs={
            "net_arch": layers,
            "n_critics": settings.critics,
            "n_quantiles": settings.quantiles,
        },
        top_quantiles_to_drop_per_net=settings.dropped,
        learning_rate=settings.learning_rate,
        buffer_size=500,
        batch_size=settings.batch_size,
        tau=settings.tau,
        gamma=settings.gamma,
        seed=0,
        device="cpu",
    )
    agent.set_logger(Logger(folder=None, output_formats=[]))
    agent.policy.to(dtype)
    agent.log_ent_coef.data = torch.full((1,), -0.7, dtype=dtype)
    agent.replay_buffer.to_torch = lambda array, copy=True: torch.tensor(array, dtype=dtype)
    return agent


def parameters_of_tqc(agent):
    """Parameters of sb3-contrib's TQC by the names of the page's rule."""
    actor = [m for m in agent.actor.latent_pi if isinstance(m, nn.Linear)]
    heads = agent.actor.mu, agent.actor.log_std
    named = {}
    for kind in ("weight", "bias"):
        for i, module in enumerate(actor):
            named[f"actor.{2 * i}.{kind}"] = getattr(module, kind)
        joined = torch.cat([getattr(head, kind) for head in heads])
        named[f"actor.{2 * len(actor)}.{kind}"] = joined
    for name, critic in (("critics", agent.critic), ("critics_target", agent.critic_target)):
        for number, network in enumerate(critic.q_networks):
            named |= {f"{name}.{number}.{key}": v for key, v in network.named_parameters()}
    return {name: values.detach() for name, values in named.items()}


def test_tqc_of_the_page_equals_sb3_contrib(monkeypatch):
    dtype, settings = torch.float64, TQC_SETTINGS
    agent, data = oracle_of_tqc(settings, dtype, monkeypatch), transitions()
    fill(agent, data)
    tensors, (learner,), _ = learners(TQC, settings, dtype)
    for name, values in parameters_of_tqc(agent).items():
        learner._parameters[name].copy_(values)
    for update in range(1, 21):
        # sb3-contrib steps the entropy coefficient before the actor, and the rule after it.
        learner._parameters["log_alpha"].copy_(agent.log_ent_coef.detach())
        batch = next_batch(data, settings, 2, dtype, update)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        learner.reset_losses([True])
        learner.update(batch)
        recorded = agent.logger.name_to_value
        assert mean_losses(learner, tensors) == pytest.approx(
            {name: recorded[f"train/{name}"] for name in ("critic_loss", "actor_loss")}, rel=1e-6
        )
    for name, values in parameters_of_tqc(agent).items():
        torch.testing.assert_close(learner._parameters[name], values, rtol=0, atol=1e-7, msg=name)


def test_the_loss_of_tqcs_entropy_coefficient_equals_sb3_contrib(monkeypatch):
    dtype = torch.float64
    agent, data = oracle_of_tqc(TQC_SETTINGS, dtype, monkeypatch), transitions()
    fill(agent, data)
    rule = made(TQC, TQC_SETTINGS, SIZE).to(dtype)
    known = {**parameters_of_tqc(agent), "log_alpha": agent.log_ent_coef.detach().clone()}
    rule.load_state_dict(known)
    batch = next_batch(data, TQC_SETTINGS, 2, dtype, 1)
    agent.train(gradient_steps=1, batch_size=TQC_SETTINGS.batch_size)
    expected = agent.logger.name_to_value["train/ent_coef_loss"]
    assert rule("coefficient_loss", batch).item() == pytest.approx(expected, rel=1e-7)


def changed(**attributes):
    """TD3 with other attributes."""
    return type("Faulty", (TD3,), attributes)


def with_actor(*layers):
    class Faulty(TD3):
        def __init__(self, settings, observation_size):
            super().__init__(settings, observation_size)
            self.actor = nn.Sequential(nn.Linear(observation_size, 8), *layers)

    return Faulty


class WithBatchNorm(TD3):
    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.normalization = nn.BatchNorm1d(observation_size)

    def actor_loss(self, batch):
        return self.normalization(batch.observations).mean() + super().actor_loss(batch)


class WithDropout(TD3):
    def actor_loss(self, batch):
        return nn.functional.dropout(batch.rewards).mean() + super().actor_loss(batch)


class PerTransition(TD3):
    def actor_loss(self, batch):
        return self.act(batch.observations)[:, 0]


class OfTheCritics(TD3):
    def actor_loss(self, batch):
        return self.critics[0](batch.state_actions).mean()


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        (changed(losses={}), "it has no losses"),
        (changed(losses={"loss": "actor"}), "it has no method loss"),
        (changed(losses={"actor_loss": "policy"}), "actor_loss trains policy, which is no network"),
        (changed(targets=("critic",)), "has no critic, which is among its targets"),
        (changed(delayed=("critic",)), "critic is delayed, but neither trained nor a target"),
        (with_actor(nn.Tanh()), "its actor is no nn.Sequential that ends in a Linear layer"),
        (PerTransition, r"actor_loss returns \(16,\), not one number; take the mean"),
        (WithDropout, "actor_loss draws random numbers; use batch.noise"),
        (WithBatchNorm, "actor_loss changes a buffer, such as the statistics of BatchNorm"),
        (OfTheCritics, "actor_loss does not depend on actor, which it trains"),
    ],
)
def test_a_faulty_rule_is_refused_before_the_training(rule, sentence):
    with pytest.raises(WorkError, match=f"The rule {rule.__name__} .*{sentence}"):
        engine_of(rule, TD3_SETTINGS, [0])


def test_a_policy_that_cannot_be_saved_is_refused_before_the_training():
    with pytest.raises(UnsupportedPolicyError, match="Softsign"):
        engine_of(with_actor(nn.Softsign(), nn.Linear(8, 1)), TD3_SETTINGS, [0])


def test_layers_other_than_relu_are_kept():
    rule = with_actor(nn.LayerNorm(8), nn.Tanh(), nn.Linear(8, 1))
    with engine_of(rule, TD3_SETTINGS, [0]) as engine:
        kinds = [layer.kind for layer in engine.policy(0).layers]
    assert kinds == ["linear", "layer_norm", "tanh", "linear", "tanh"]


def test_the_public_names_are_those_of_the_engine():
    assert (jbench.Rule, jbench.Batch) == (Rule, Batch)
    assert issubclass(jbench.Rule.Settings, jbench.OffPolicySettings)


def test_delayed_updates_and_their_losses_follow_the_rule():
    _, (learner,), _ = learners(TD3, TD3_SETTINGS)
    assert [learner.is_delayed_update(update, 0) for update in (1, 2, 3, 4)] == [False, True] * 2
    before = {name: values.clone() for name, values in learner._parameters.items()}
    (numbers,) = batches(TD3, 1, torch.float32)
    learner.update(Batch(*numbers), delayed=False)
    changed = {n for n, values in learner._parameters.items() if not torch.equal(values, before[n])}
    assert {name.split(".")[0] for name in changed} == {"critics"}
