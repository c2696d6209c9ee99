"""Tests of algorithm settings, against Table 1 of the paper and its library's defaults."""

import enum
import inspect
import json
import math
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

import jbench
from jbench.agents.sb3 import CLASSES
from jbench.commands.parsing import parse_overrides
from jbench.errors import RequestError
from jbench.settings.algorithms import (
    ALGORITHMS,
    SETTINGS,
    DDPGSettings,
    OffPolicySettings,
    algorithm_settings,
)
from jbench.settings.base import settings_with
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.shipped import shipped
from tests.training.small_runs import requested

SHARED = {"learning_rate": 1e-4, "gamma": 0.99, "hidden_layers": (350, 250)}
OFF_POLICY = {**SHARED, "batch_size": 256, "buffer_size": 1_000_000, "noise_dt": 0.01}
NORMAL_NOISE = {"action_noise": "normal", "noise_mean": 0.0, "noise_sigma": 0.2}
PUBLISHED = {
    "ddpg": {
        **OFF_POLICY,
        "action_noise": "ornstein-uhlenbeck",
        "noise_mean": 0.3,
        "noise_sigma": 0.3,
        "noise_theta": 0.15,
        "train_freq": 100,
        "gradient_steps": 50,
        "tau": 0.001,
        "learning_starts": 256,  # a batch can be drawn
        "uniform_warmup": False,
    },
    "td3": {
        **OFF_POLICY,
        **NORMAL_NOISE,
        "noise_theta": 0.15,
        "learning_starts": 10_000,
        "gradient_steps": 1000,
        "train_freq": 1000,
        "tau": 0.005,
        "policy_delay": 2,
        "target_policy_noise": 0.2,
        "target_noise_clip": 0.5,
        "uniform_warmup": True,
    },
    "sac": {
        **OFF_POLICY,
        **NORMAL_NOISE,
        "noise_theta": 0.15,
        "ent_coef": "auto",
        "target_entropy": -1.0,
        "target_update_interval": 1,
        "learning_starts": 100,
        "train_freq": 1,
        "gradient_steps": 1,
        "tau": 0.005,
        "uniform_warmup": True,
    },
    "ppo": {
        **SHARED,
        "n_envs": 8,
        "n_steps": 256,
        "batch_size": 8 * 256 // 4,  # 4 minibatches
        "n_epochs": 4,
        "ent_coef": 0.01,
        "gae_lambda": 0.95,
        "vf_coef": 0.5,
        "max_grad_norm": 0.5,
        "clip_range": 0.2,
        "clip_range_vf": 0.2,  # stable-baselines 2 clips it like the policy
        "normalize_advantage": True,
    },
}


@pytest.mark.parametrize("algo", PUBLISHED)
def test_defaults_are_published_settings(algo):
    assert algorithm_settings(algo).model_dump() == PUBLISHED[algo]


# Differences of the authors' script, from the script and the source of stable-baselines 2.
SCRIPT = {
    "ddpg": {
        "initialization": "glorot",  # tf.layers.dense
        "last_layer_bound": 3e-3,
        "action_layer": 1,
        "gradients_first": True,
    },
    "td3": {"initialization": "glorot", "learning_starts": 9_999},
    "ppo": {
        "n_steps": 256 // 8,  # of 8 environments
        "batch_size": 8 * 32 // 4,  # 4 minibatches
        "clip_range": 0.1,
        "clip_range_vf": 0.1,
        "vf_coef": 0.5 * 0.5,  # 0.5, of half the squared error
        "value_loss": "max",
        "shared_layers": True,
    },
}


@pytest.mark.parametrize("algo", SCRIPT)
def test_script_settings_differ_only_by_table(algo):
    settings = algorithm_settings(algo, "script")
    assert settings.model_dump() == {**PUBLISHED[algo], **SCRIPT[algo]}
    assert algorithm_settings(algo, overrides=SCRIPT[algo]) == settings


def test_documentation_lists_every_script_setting():
    text = (Path(__file__).parents[2] / "docs" / "agents.md").read_text()
    table = text.split("## The authors' script")[1].split("Not reproduced")[0]
    for algo, changes in SCRIPT.items():
        for name, value in changes.items():
            assert f"`{name}={json.dumps(value).strip(chr(34))}`" in table, (algo, name)


def test_script_settings_of_sac_are_refused():
    with pytest.raises(RequestError, match="script are for ddpg, ppo, td3: the script's sac is"):
        algorithm_settings("sac", "script")


def test_new_settings_do_not_change_ids_of_older_runs():
    runs = Results(shipped()).scan("run")[0]
    assert len(runs) > 20
    for run in runs:
        algorithm = SETTINGS[run.settings["algo"]](**run.settings["hyperparameters"])
        again = {**run.settings, "hyperparameters": algorithm.model_dump(mode="json")}
        assert RunSettings(**again).id == run.id


SOURCES = ("Table 1", "section 4.2", "stable-baselines 2", "stable-baselines3", "script", "ours")


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_every_setting_says_what_it_means_and_then_its_source(algo):
    for name, field in SETTINGS[algo].model_fields.items():
        meaning, _, source = field.description.rpartition("; ")
        assert source.startswith(SOURCES), name
        assert len(meaning.split()) > 2, name
        assert not meaning.startswith(SOURCES), name


# Defaults of stable-baselines 2.10: of its classes DDPG, TD3, SAC and PPO2, and of the noise.
NOISE_STEP = {"noise_dt": 1e-2}
STABLE_BASELINES_2 = {
    "ddpg": {
        **NOISE_STEP,
        "normalize_clip": 5.0,  # observation_range
        "learning_starts": 256,  # it waits for a minibatch
        "uniform_warmup": False,  # random_exploration
        "train_freq": 100,  # nb_rollout_steps
        "gradient_steps": 50,  # nb_train_steps
        "tau": 0.001,
    },
    "td3": {
        **NOISE_STEP,
        "normalize_clip": 5.0,  # of DDPG: TD3 and SAC standardize nothing
        "uniform_warmup": True,
        "tau": 0.005,
        "policy_delay": 2,
        "target_policy_noise": 0.2,
        "target_noise_clip": 0.5,
    },
    "sac": {
        **NOISE_STEP,
        "normalize_clip": 5.0,
        "learning_starts": 100,
        "uniform_warmup": True,
        "train_freq": 1,
        "gradient_steps": 1,
        "tau": 0.005,
        "ent_coef": "auto",
        "target_entropy": -1.0,  # auto: minus the size of an action
        "target_update_interval": 1,
    },
    "ppo": {
        "batch_size": 8 * 256 // 4,  # nminibatches
        "n_epochs": 4,  # noptepochs
        "gae_lambda": 0.95,  # lam
        "clip_range": 0.2,
        "clip_range_vf": 0.2,  # that of the policy
        "normalize_advantage": True,
        "max_grad_norm": 0.5,
    },
}


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_settings_with_the_source_stable_baselines_2_are_its_defaults(algo):
    """vf_coef is not: there, it is the weight of half the squared error."""
    fields = SETTINGS[algo].model_fields
    found = {
        name: field.default
        for name, field in fields.items()
        if field.description.rpartition("; ")[2].startswith("stable-baselines 2")
    }
    assert found == STABLE_BASELINES_2[algo]


def test_documented_first_updates():
    text = (Path(__file__).parents[2] / "docs" / "agents.md").read_text()
    (row,) = (line for line in text.splitlines() if line.startswith("| first update after"))
    first = [algorithm_settings(algo).first_update() for algo in ("ddpg", "td3", "sac")]
    first.append(algorithm_settings("ppo").rollout(8))  # it learns from its first rollout
    assert [cell.strip() for cell in row.split("|")[3:-1]] == [f"{steps:,}" for steps in first]


def test_another_default_keeps_the_meaning():
    shared, ddpg = (kind.model_fields["tau"] for kind in (OffPolicySettings, DDPGSettings))
    assert (shared.default, ddpg.default) == (0.005, 0.001)
    assert ddpg.description == shared.description
    with pytest.raises(ValidationError, match="less than or equal to 1"):
        DDPGSettings(tau=1.5)


# Settings of Table 1 and section 4.2, which replace the library's defaults.
OFF_POLICY_NOISE = {"action_noise", "noise_mean", "noise_sigma", "noise_theta", "noise_dt"}
FROM_PAPER = {
    "ddpg": {"buffer_size"} | OFF_POLICY_NOISE,
    "sac": {"buffer_size"} | OFF_POLICY_NOISE,
    "td3": {"buffer_size", "learning_starts", "train_freq", "gradient_steps"} | OFF_POLICY_NOISE,
    "ppo": {"n_envs", "n_steps", "ent_coef"},
}


@pytest.mark.parametrize("algo", FROM_PAPER)
def test_sb3_settings_are_library_defaults_except_table_1(algo):
    settings = algorithm_settings(algo, "sb3").model_dump()
    fixed = FROM_PAPER[algo] | {"learning_rate", "batch_size", "gamma", "hidden_layers"}
    parameters = inspect.signature(CLASSES[algo]).parameters
    published = {**PUBLISHED[algo], "batch_size": 256}  # Table 1
    for name, value in settings.items():
        if name in fixed:
            assert value == published[name], name
        elif name in parameters:
            default = parameters[name].default
            assert value == default, name


def test_speed_of_ppo_is_measured_over_one_rollout_of_the_environments():
    ppo = algorithm_settings("ppo")  # 8 environments of 256 control steps each
    assert ppo.measurement(8, "cpu", 40).rollout == 2048
    assert ppo.measurement(3, "cpu", 40).rollout == 3 * (2048 // 3)


@pytest.mark.parametrize("layers", ["[64,32]", "64,32"])
def test_overrides_replace_single_settings(layers):
    overrides = parse_overrides(["tau=0.01", f"hidden_layers={layers}", "action_noise=none"])
    settings = algorithm_settings("td3", overrides=overrides)
    changed = {"tau": 0.01, "hidden_layers": (64, 32), "action_noise": "none"}
    assert settings.model_dump() == {**PUBLISHED["td3"], **changed}
    assert parse_overrides(["action_noise=a,b"]) == {"action_noise": "a,b"}


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("policy_delay=2", "ddpg has no setting policy_delay; it has .*tau"),
        ("tau=fast", "tau of ddpg can't be 'fast'"),
        ("tau=0", "tau of ddpg can't be 0"),
        ("batch_size=2.5", "batch_size of ddpg can't be 2.5"),
        ("batch_size=1e20", "batch_size of ddpg can't be 100000000000000000000"),
        ("action_noise=pink", "action_noise of ddpg can't be 'pink'"),
        ("hidden_layers=64", "hidden_layers of ddpg can't be 64"),
        ("learning_rate=-1", "learning_rate of ddpg can't be -1"),
        ("learning_rate=NaN", "learning_rate of ddpg can't be nan"),
        ("buffer_size=true", "buffer_size of ddpg can't be True"),
        ("action_layer=2", "action_layer of ddpg can't be 2"),
        ("last_layer_bound=0", "last_layer_bound of ddpg can't be 0"),
        ("initialization=he", "initialization of ddpg can't be 'he'"),
        ("shared_layers=true", "ddpg has no setting shared_layers"),
        ("action_layer=1 hidden_layers=[]", "action_layer=1 needs a critic with hidden layers"),
        ("tau", "NAME=VALUE"),
        ("=0.1", "NAME=VALUE"),
        ("tau=0.1 tau=0.2", "each setting once"),
    ],
)
def test_invalid_override_is_refused(typed, message):
    with pytest.raises(RequestError, match=message):
        algorithm_settings("ddpg", overrides=parse_overrides(typed.split()))


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("ent_coef=foo", "ent_coef of sac can't be 'foo': it should be a valid number, or 'auto'."),
        (
            "ent_coef=-1",
            "ent_coef of sac can't be -1: it should be greater than or equal to 0, or 'auto'.",
        ),
        (
            "target_entropy=[1]",
            "target_entropy of sac can't be [1]: it should be a valid number, or 'auto'.",
        ),
        ("hidden_layers=[64,-1]", "hidden_layers.1 of sac can't be -1: it should be greater than "),
    ],
)
def test_refusal_of_a_value_names_each_type_that_it_may_have(typed, message):
    with pytest.raises(RequestError) as refused:
        algorithm_settings("sac", overrides=parse_overrides([typed]))
    assert str(refused.value).startswith(message)


def test_whole_number_may_be_typed_as_float(tmp_path):
    def run(*typed):
        return requested(Results(tmp_path), parse_overrides(list(typed)), encoder="ofe12")

    typed_as_float = run("batch_size=1e3", "gamma=1", "ofe.layers=2.0", "ofe.pretraining=2")
    assert type(typed_as_float.hyperparameters["batch_size"]) is int
    assert type(typed_as_float.hyperparameters["gamma"]) is float
    whole = run("batch_size=1000", "gamma=1.0", "ofe.layers=2", "ofe.pretraining=2.0")
    assert typed_as_float.id == whole.id
    with pytest.raises(RequestError, match=r"batch_size of td3 can't be 1000\.5"):
        run("batch_size=1000.5")


class Kind(enum.Enum):
    SMALL, LARGE = "small", "large"


class Own(jbench.AgentSettings):
    speed: int
    units: tuple[int, ...] = (64, 64)
    kind: Kind = Kind.LARGE
    noise: float = 0.1
    more: Any = None


def test_recorded_settings_of_every_json_type_are_read_again():
    chosen = settings_with(Own, "own", {"speed": 1, "units": [8], "noise": 1 / 3})
    assert chosen == Own(speed=1, units=(8,), noise=1 / 3)
    assert settings_with(Own, "own", chosen.model_dump(mode="json")) == chosen


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"speed": 1, "units": 8}, "units of own can't be 8: it should be a list in brack"),
        ({}, "the setting speed of own is missing: give it"),
        *(
            ({"speed": 1, "more": more}, r"more of own can't be .*: numbers must be finite\.")
            for more in (math.nan, [1, math.inf], {"a": {"b": -math.inf}})
        ),
    ],
)
def test_wrong_settings_of_other_packages_are_refused(chosen, message):
    with pytest.raises(RequestError, match=message):
        settings_with(Own, "own", chosen)
