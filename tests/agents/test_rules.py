"""Tests of the rules that users subclass: their updates, their settings, and the documented one."""

import pytest
import torch

import jbench
from jbench.agents.algorithms import algorithm_fields, describe_settings
from jbench.agents.batched.replay import Batch
from jbench.errors import RequestError
from jbench.settings.algorithms import ForeignRule
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.training.continuation import check_state_can_be_kept
from jbench.training.speed import learning_share
from tests.agents.batched_oracle import (
    SIZE,
    build_learner,
    build_settings,
    linear_layers,
    mean_losses,
)
from tests.agents.small_rules import SCHEDULE, SMALL, batches, build_engine, learners
from tests.agents.test_plain_updates import (
    FAST,
    PLAIN,
    SCRIPT,
    assert_equal_parameters,
    assert_uniform,
    copy_parameters,
    paired_layers,
    transitions,
)
from tests.agents.test_plugin_engine import RandomAgent
from tests.demo_results import ENCODER
from tests.documentation import code_of
from tests.matrices import diagonal
from tests.training.small_runs import requested

RULES = {"ddpg": jbench.rules.DDPG, "td3": jbench.rules.TD3, "sac": jbench.rules.SAC}
CASES = [
    ("ddpg", FAST),
    ("ddpg", {**FAST, "action_layer": 1}),
    ("ddpg", {**FAST, "gradients_first": True}),
    ("ddpg", {**FAST, **SCRIPT["ddpg"]}),
    ("td3", FAST),
    ("sac", {**FAST, "target_entropy": "auto"}),
]


ODD_RULE = """
import jbench

class Odd(jbench.rules.TD3):
    class Settings(jbench.rules.TD3.Settings):
        scale: float = float("inf")
        key: bytes = b"\\xff"

class Sets(jbench.rules.TD3):
    class Settings(jbench.rules.TD3.Settings):
        words: set[str] = {"one", "two", "three", "four", "five"}
"""


def subclass(algo):
    """A rule of a user, which overrides nothing."""
    return type("Unchanged", (RULES[algo],), {})


def own_networks(algo, rule):
    """Gives the target critics the name that they have in jbench's own learners."""
    if algo != "ddpg":
        rule.critic_targets = rule.critics_target
    return rule


@pytest.mark.parametrize(("case", "actions"), diagonal(CASES, (1, 6)))
def test_unchanged_subclass_makes_the_updates_of_the_plain_version(case, actions):
    algo, changes = case
    settings = build_settings(algo, **changes)
    plain = PLAIN[algo][0](settings, SIZE, actions)
    _, (learner,), _ = learners(subclass(algo), settings, torch.float64, actions=actions)
    for name in PLAIN[algo][1]:
        ours = linear_layers(getattr(own_networks(algo, learner.rule), name))
        for layer, expected in zip(ours, linear_layers(getattr(plain, name)), strict=True):
            expected.load_state_dict(layer.state_dict())
    random = torch.Generator().manual_seed(2)
    for number in range(1, 31):
        batch = transitions(random, actions, learner.noise_per_transition)
        delayed = learner.is_delayed_update(number, 0)
        plain.update(batch, *([delayed] if algo == "td3" else []))
        learner.update(batch, delayed)
    for name in PLAIN[algo][1]:
        parameters = getattr(learner.rule, name).parameters()
        for ours, expected in zip(parameters, getattr(plain, name).parameters(), strict=True):
            torch.testing.assert_close(ours.data, expected.data, rtol=0, atol=1e-10)
    if algo == "sac":
        assert plain.log_temperature.item() != 0
        torch.testing.assert_close(
            learner.rule.log_temperature.data, plain.log_temperature.data, rtol=0, atol=1e-10
        )


@pytest.mark.parametrize(
    ("algo", "changes"),
    [
        ("td3", {"policy_delay": 3}),
        ("sac", {"ent_coef": 0.2, "target_update_interval": 2}),
        ("sac", {"target_entropy": -3.0}),
    ],
)
def test_rule_makes_the_updates_of_the_algorithm_with_its_settings(algo, changes):
    settings = build_settings(algo, **FAST, **changes)
    own_tensors, own = build_learner(algo, settings, torch.float64)
    tensors, (learner,), _ = learners(subclass(algo), settings, torch.float64)
    own.initialize(torch.Generator().manual_seed(3))
    layers = [*paired_layers(algo, own, own_networks(algo, learner.rule))]
    copy_parameters(layers)
    for number, parts in enumerate(batches(learner, 30), 1):
        delayed = learner.is_delayed_update(number, number - 1)
        assert own.is_delayed_update(number, number - 1) == delayed
        for updated in (own, learner):
            updated.reset_losses([delayed])
            updated.update(Batch(*(part.clone() for part in parts)), delayed)
    # Initial numbers of a rule, such as the logarithm of a temperature, are float32.
    assert_equal_parameters(layers, 1e-8)
    expected = mean_losses(own, own_tensors)
    expected.pop("entropy_coefficient", None)
    assert mean_losses(learner, tensors) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("algo", ["ddpg", "td3"])
def test_script_settings_have_glorot_initialization(algo):
    settings = build_settings(algo, **{**SCRIPT[algo], "hidden_layers": [200, 100]})
    rule = RULES[algo](settings, SIZE)
    *hidden, last = linear_layers(rule.actor)
    for layer in hidden:
        assert_uniform(layer.weight.data, (6 / sum(layer.weight.shape)) ** 0.5)
        assert not layer.bias.any()
    bound = 3e-3 if algo == "ddpg" else (6 / sum(last.weight.shape)) ** 0.5
    assert_uniform(last.weight.data, bound)


def documented():
    names = {}
    exec(code_of("your-own-rule.md", "python", "class HuberTD3"), names)  # noqa: S102
    exec(code_of("your-own-rule.md", "python", "class ScaledTD3"), names)  # noqa: S102
    return names["HuberTD3"], names["ScaledTD3"]


@pytest.mark.parametrize("stacked", [False, True])
def test_documented_subclass_is_trained_with_its_own_network_and_loss(stacked):
    huber, _ = documented()
    settings = huber.Settings(**SMALL, **SCHEDULE)
    with build_engine(huber, settings, [0, 1], stacked=stacked) as engine:
        before = engine.state(1).tensors["agent/rule.critics"].clone()
        list(engine.learn(60))
        after = engine.state(1).tensors["agent/rule.critics"]
    assert (after - before).abs().max() > 1e-3
    # A gain of a normalization begins at 1 and a weight below 1: 24 + 20 gains of two critics.
    gains = before == 1
    assert gains.sum() == 2 * (24 + 20)
    # Those of units that no observation has activated are not trained.
    assert (after[gains] != 1).float().mean() > 0.5


def test_documented_loss_is_that_of_huber():
    huber, scaled = documented()
    settings = huber.Settings(**SMALL, **SCHEDULE)
    _, (learner,), _ = learners(huber, settings, torch.float64)
    (parts,) = batches(learner, 1)
    batch, rule = Batch(*parts), learner.rule
    errors = [critic(batch.state_actions) - rule.target_values(batch) for critic in rule.critics]
    expected = sum(
        torch.where(e.abs() < 1, 0.5 * e.square(), e.abs() - 0.5).mean().item() for e in errors
    )
    assert rule.critic_loss(batch).item() == pytest.approx(expected, rel=1e-12)

    twice = scaled.Settings(**SMALL, **SCHEDULE, reward_scale=2)
    _, (plain,), _ = learners(jbench.rules.TD3, settings, torch.float64)
    _, (doubled,), _ = learners(scaled, twice, torch.float64)
    added = doubled.rule.target_values(batch) - plain.rule.target_values(batch)
    torch.testing.assert_close(added, batch.rewards, rtol=0, atol=1e-12)


@pytest.mark.parametrize("task", ["face_direction", "dm:cartpole-balance"])
@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac"])
def test_rule_has_the_settings_of_its_algorithm_on_each_task(algo, task):
    expected = algorithm_fields(algo, task=task)["hyperparameters"]
    name = f"jbench.rules:{RULES[algo].__name__}"
    assert algorithm_fields(name, task=task)["hyperparameters"] == expected


def test_rule_takes_the_sources_of_its_algorithm_only():
    fields = algorithm_fields("jbench.rules:DDPG", base="figure8")
    assert fields["hyperparameters"]["hidden_layers"] == [300, 300, 300]
    with pytest.raises(RequestError, match=r"no settings script for jbench.rules:SAC: it has pub"):
        algorithm_fields("jbench.rules:SAC", base="script")


def test_setting_that_is_no_json_is_refused_by_its_name(tmp_path, monkeypatch):
    (tmp_path / "odd_rule.py").write_text(ODD_RULE)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RequestError, match=r"The setting scale of odd_rule:Odd is inf, which can"):
        algorithm_fields("odd_rule:Odd")
    with pytest.raises(RequestError, match=r"The setting key of odd_rule:Odd is b'\\xff', which"):
        describe_settings("odd_rule:Odd")
    fields = algorithm_fields("odd_rule:Sets")
    assert fields["hyperparameters"]["words"] == ["five", "four", "one", "three", "two"]


@pytest.mark.parametrize("environments", [None, 3])
def test_rule_of_a_user_has_the_rollouts_of_its_settings(environments, tmp_path):
    schedule = {"train_freq": 300, "learning_starts": 400, "gradient_steps": 300}
    ours, theirs = (
        requested(Results(tmp_path), schedule, algo=algo).model_copy(
            update={"parallel": environments}
        )
        for algo in ("td3", "jbench.rules:TD3")
    )
    assert (theirs.rollout, theirs.last_step, theirs.first_update) == (300, 1200, 600)
    assert (ours.rollout, ours.last_step, ours.first_update) == (300, 1200, 600)
    assert learning_share(ours) == learning_share(theirs) == 0.75
    assert theirs.algorithm.knows_rollouts


def test_state_of_a_rule_that_ends_within_an_episode_is_refused_at_once():
    task = "dmc:cartpole-swingup"
    assert not find_task(task).has_state_within_episode
    fields = algorithm_fields("jbench.rules:TD3", overrides={"train_freq": 300}, task=task)
    lengths = {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 1}
    run = RunSettings(task=task, specs=find_task(task).specs, seed=0, **lengths, **fields)
    with pytest.raises(RequestError, match="last control step is the 1,200th; type --steps 3000"):
        check_state_can_be_kept([run])


def test_rule_with_odd_times_of_updates_in_its_record_can_be_read():
    for odd in (0, -1, True, "often", 10**30, None):
        settings = ForeignRule(hyperparameters={"train_freq": odd, "learning_starts": odd})
        assert settings.rollout(1) == (10**30 if odd == 10**30 else 1)


def test_only_rules_have_the_mirror_of_the_engine(tmp_path, demo_results):
    """The agent's argument is a word of its own."""
    specs = find_task("tests.odd_tasks:Fragile").specs
    about = {"task": "tests.odd_tasks:Fragile", "specs": specs, "seed": 0, "steps": 100}
    about |= {"evaluate_every": 100, "evaluate_episodes": 1, "hyperparameters": {"mirror": "left"}}
    agent = RunSettings(**about, engine="plugin", algo="own:Agent")
    assert not agent.algorithm.is_mirrored
    with pytest.raises(ValueError, match="no mirror image is known of"):
        RunSettings(**about, engine="batched", algo="own:Rule")

    run = requested(demo_results, {"mirror": "left"}, f"{__name__}:Mirrored", ENCODER)
    assert (run.engine, run.hyperparameters) == ("plugin", {"mirror": "left"})
    with pytest.raises(RequestError, match="mirror"):
        requested(demo_results, {"mirror": True}, "jbench.rules:TD3", ENCODER)


class Mirrored(RandomAgent):
    """An agent with an argument that is called as one of the batched engine."""

    class Settings(jbench.AgentSettings):
        mirror: str = "right"
