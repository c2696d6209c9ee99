"""Tests of algorithms given by class name, with the interface of stable-baselines3."""

import numpy as np
import pytest
from sb3_contrib import TQC

from jbench.agents import sb3
from jbench.agents.algorithms import algorithm_fields
from jbench.errors import RequestError
from jbench.settings.recorded import read_run
from jbench.settings.run import RunSettings
from jbench.store import Results
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


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run of TQC: one episode, with learning in its last 20 steps."""
    results = Results(tmp_path_factory.mktemp("results"))
    settings = requested(results, SMALL, algo=NAME)
    return settings, train(settings, results)


def test_run_of_class_is_recorded(finished):
    settings, record = finished
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
    agent = sb3.build(NAME, SMALL, _env(actions), 3)
    assert isinstance(agent, TQC)
    assert type(agent.actor.latent_pi[1]).__name__ == "Tanh"
    network = sb3.copy_model(agent)
    observations = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    wanted, _ = agent.predict(observations, deterministic=True)
    assert wanted.shape == (5, actions)
    assert network.act(observations) == pytest.approx(wanted, abs=1e-6)


def test_lists_and_noise_are_converted_to_arguments():
    # The noise has a number for each of the actions.
    settings = {**SMALL, "train_freq": [2, "episode"], "action_noise": 0.25}
    agent = sb3.build("stable_baselines3:TD3", settings, _env(3), 0)
    assert agent.train_freq.frequency == 2
    assert agent.train_freq.unit.value == "episode"
    assert agent.action_noise._sigma.tolist() == [0.25] * 3


def test_arguments_by_position_are_no_settings():
    assert set(build_settings(f"{__name__}:Wrapped")) == {"own"}
    with pytest.raises(RequestError, match="Wrapped has no setting rest; it has own"):
        build_settings(f"{__name__}:Wrapped", rest=[1])


def test_number_that_is_not_finite_is_refused():
    with pytest.raises(RequestError, match="gamma of sb3_contrib:TQC can't be nan: numbers must"):
        build_settings(NAME, gamma=float("nan"))


def test_none_replaces_a_default():
    settings = build_settings("stable_baselines3:PPO", target_kl=0.1)
    assert settings["clip_range_vf"] is None
    agent = sb3.build("stable_baselines3:PPO", {**settings, "target_kl": None}, _env(), 0)
    assert agent.target_kl is None


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
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


def test_unknown_argument_is_refused():
    with pytest.raises(RequestError, match=r"TQC has no setting tua; .*tau"):
        build_settings(NAME, tua=1)


def test_number_of_environments_is_separate_setting():
    fields = algorithm_fields("sb3_contrib:TRPO", overrides={"n_steps": 10})
    about = {"task": "face_direction", "seed": 0, "steps": 1000, "evaluate_every": 1}
    settings = RunSettings(**about, **fields, evaluate_episodes=0, parallel=4)
    assert settings.environments == 4


def _env(actions=1):
    return sb3.DummyVecEnv([lambda: sb3.Spaces(16, actions)])
