"""Tests of stable-baselines3 agents, of jbench's algorithms and of classes given by name."""

import numpy as np
import pytest
import torch
from sb3_contrib import TQC

from jbench.agents import sb3
from jbench.agents.algorithms import algorithm_fields
from jbench.agents.sb3_policies import copy_model
from jbench.errors import RequestError
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import Foreign, algorithm_settings
from jbench.settings.recorded import read_run
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.gym import RobotEnv
from tests.training.small_runs import requested, train

NAME = "sb3_contrib:TQC"
SMALL = {
    "learning_starts": 980,
    "batch_size": 8,
    "buffer_size": 2000,
    "policy_kwargs": {"net_arch": [8], "activation_fn": "Tanh"},
}


class Wrapped(TQC):
    """Has arguments of any number and name."""

    def __init__(self, *rest, own=1, **more):
        super().__init__(*rest, **more)


def build_settings(name, **overrides):
    return algorithm_fields(name, overrides=overrides)["hyperparameters"]


def build(algo, **overrides):
    # The replay buffer of a million transitions is allocated lazily.
    settings = algorithm_settings(algo, overrides=overrides)
    environments = getattr(settings, "n_envs", 1)
    env = sb3.DummyVecEnv([lambda: RobotEnv("face_direction")] * environments)
    return sb3.build(algo, settings, env, seed=7)


# Comparisons of updates, of their number, and of the first actions find errors in these settings.
COMPARED = {"action_noise", "noise_mean", "noise_sigma", "noise_theta", "noise_dt", "train_freq"}
COMPARED |= {"hidden_layers", "uniform_warmup", "clip_range", "clip_range_vf"}


@pytest.mark.parametrize("algo", sb3.CLASSES)
def test_agents_have_the_settings(algo):
    settings, agent = algorithm_settings(algo), build(algo)
    for name, value in settings.model_dump(exclude=COMPARED).items():
        assert getattr(agent, name) == value, name


def test_actions_before_learning_starts_are_uniform_or_of_policy():
    agents = [build(algo, noise_sigma=0.0, noise_mean=0.0) for algo in ("td3", "ddpg")]
    for agent in agents:
        agent._setup_learn(1000)
    td3, ddpg = agents
    actions = [td3._sample_action(10_000, td3.action_noise, 1)[0] for _ in range(200)]
    # The standard deviation of U(-1, 1) is 0.577; a policy would give one action.
    assert 0.5 < np.std(actions) < 0.65
    action, _ = ddpg._sample_action(ddpg.learning_starts, ddpg.action_noise, 1)
    np.testing.assert_array_equal(action, ddpg.predict(ddpg._last_obs, deterministic=True)[0])


@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac"])
def test_actions_before_learning_starts_are_of_the_policy_if_so_set(algo):
    agent = build(algo, uniform_warmup=False, action_noise="none", learning_starts=100)
    agent._setup_learn(1000)
    seen = agent._last_obs
    drawn = algo == "sac"

    torch.manual_seed(3)
    action, _ = agent._sample_action(agent.learning_starts, agent.action_noise, 1)

    torch.manual_seed(3)
    np.testing.assert_array_equal(action, agent.predict(seen, deterministic=not drawn)[0])


@pytest.mark.parametrize("algo", sb3.CLASSES)
def test_saved_policy_is_copy_that_equals_agent(algo):
    agent = build(algo, hidden_layers=[24, 16])
    observations = np.random.default_rng(0).normal(size=(50, 16)).astype(np.float32)
    expected, _ = agent.predict(observations, deterministic=True)
    kept = copy_model(agent)
    with torch.no_grad():
        for parameter in agent.policy.parameters():
            parameter += 1
    policy = SavedNetwork.from_files(*kept.files().values())
    np.testing.assert_allclose(policy.act(observations), expected, atol=2e-6)
    np.testing.assert_allclose(policy.act(observations[3]), expected[3], atol=2e-6)


def test_run_of_class_is_recorded(tmp_path):
    """It has one episode, with learning in its last 20 steps."""
    settings = requested(Results(tmp_path), SMALL, algo=NAME)
    record = train(settings, Results(tmp_path))
    assert settings.id.startswith("face_direction/sb3_contrib.TQC/full/s00-")
    assert (settings.engine, settings.algo) == ("sb3", NAME)
    assert settings.hyperparameters["top_quantiles_to_drop_per_net"] == 2
    assert settings.hyperparameters["learning_starts"] == 980
    assert record.status == "finished"
    assert record.manifest.provenance["package"].startswith("sb3_contrib 2.")
    assert read_run(record.settings) == settings
    (row,) = record.read("episodes").to_pylist()
    assert row["critic_loss"] > 0
    assert record.rows("evaluations") == 1


@pytest.mark.parametrize("actions", [1, 6])
def test_extracted_policy_equals_model(actions):
    agent = sb3.build(NAME, Foreign(hyperparameters=SMALL), _env(actions), 3)
    assert isinstance(agent, TQC)
    assert type(agent.actor.latent_pi[1]).__name__ == "Tanh"
    network = copy_model(agent)
    observations = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    wanted, _ = agent.predict(observations, deterministic=True)
    assert wanted.shape == (5, actions)
    assert network.act(observations) == pytest.approx(wanted, abs=1e-6)


def test_lists_and_noise_are_converted_to_arguments():
    # The noise has a number for each of the actions.
    settings = {**SMALL, "train_freq": [2, "episode"], "action_noise": 0.25}
    agent = sb3.build("stable_baselines3:TD3", Foreign(hyperparameters=settings), _env(3), 0)
    assert agent.train_freq.frequency == 2
    assert agent.train_freq.unit.value == "episode"
    assert agent.action_noise._sigma.tolist() == [0.25] * 3


def test_arguments_by_position_are_no_settings():
    assert set(build_settings(f"{__name__}:Wrapped")) == {"own"}
    with pytest.raises(RequestError, match="Wrapped has no setting rest; it has own"):
        build_settings(f"{__name__}:Wrapped", rest=[1])


def test_none_replaces_a_default():
    settings = build_settings("stable_baselines3:PPO", target_kl=0.1)
    assert settings["clip_range_vf"] is None
    agent = sb3.build(
        "stable_baselines3:PPO", Foreign(hyperparameters={**settings, "target_kl": None}), _env(), 0
    )
    assert agent.target_kl is None


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
        (NAME, {"tua": 1}, r"TQC has no setting tua; .*tau"),
        (NAME, {"gamma": float("nan")}, "gamma of sb3_contrib:TQC can't be nan: numbers must"),
        (NAME, {"learning_rate": "abc"}, "can't be made with these settings .*learning rate"),
        ("sb3_contrib:QRDQN", {}, "sb3_contrib:QRDQN takes no continuous actions, which all"),
        ("sb3_contrib:CrossQ", {}, "policy of sb3_contrib:CrossQ can't be saved"),
    ],
)
def test_class_that_cannot_be_trained_is_refused(name, settings, sentence):
    with pytest.raises(RequestError, match=sentence):
        sb3.check(name, build_settings(name, **settings), (16, 1), 1)


def test_settings_are_checked_with_the_environments_of_the_run():
    by_episodes = build_settings(NAME, train_freq=[1, "episode"])
    sb3.check(NAME, by_episodes, (16, 1), 1)
    with pytest.raises(RequestError, match="can't be in episodes with 2 environments: type a"):
        sb3.check(NAME, by_episodes, (16, 1), 2)
    # A rollout has more than one step.
    ppo = "stable_baselines3:PPO"
    one_step = build_settings(ppo, n_steps=1, batch_size=2)
    sb3.check(ppo, one_step, (16, 1), 2)
    with pytest.raises(RequestError, match="n_steps"):
        sb3.check(ppo, one_step, (16, 1), 1)


def test_number_of_environments_is_separate_setting():
    fields = algorithm_fields("sb3_contrib:TRPO", overrides={"n_steps": 10})
    about = {"task": "face_direction", "seed": 0, "steps": 1000, "evaluate_every": 1}
    settings = RunSettings(**about, **fields, evaluate_episodes=0, parallel=4)
    assert settings.environments == 4


def _env(actions=1):
    return sb3.DummyVecEnv([lambda: sb3.Spaces(16, actions)])
