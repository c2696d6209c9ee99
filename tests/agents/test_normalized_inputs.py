"""Tests of inputs that are standardized by running statistics, against numpy and other packages."""

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from jbench.agents.batched.normalize import RunningStatistics, Standardization
from jbench.agents.batched.ppo import Transitions
from jbench.errors import RequestError
from jbench.policies.network import SavedNetwork
from jbench.policies.onnx_export import export_onnx
from jbench.policies.saved import TrainedAgent
from jbench.settings.algorithms import ALGORITHMS, DDPGSettings, algorithm_settings
from jbench.settings.records import OFESettings
from jbench.store import Results
from jbench.training.request import request_runs
from tests.agents.batched_oracle import (
    SIZE,
    build_learner,
    build_oracle,
    build_settings,
    copy_initial_parameters,
    fill,
    largest_difference,
    next_batch,
    parameters,
    transitions,
)
from tests.agents.small_rules import TQC, TQC_SETTINGS
from tests.agents.test_batched_engine import (
    STEPS,
    assert_continues,
    assert_independent,
    assert_loads,
    assert_policies_equal_agents,
    build_engine,
    short_engine,
    slow,
)
from tests.agents.test_batched_updates import OFF_POLICY, fill_rollout
from tests.agents.test_mirrored_minibatches import (
    ROWS,
    assert_updates_equal_autograd,
    encoded,
    replay_rows,
)
from tests.agents.test_plain_updates import PLAIN
from tests.policies.test_onnx_export import run_model
from tests.training.small_runs import TanhEncoder, small_run

RUNNING = {"normalize": "running"}
NORMALIZED = {"changes": RUNNING}
# As stable-baselines 2 standardizes.
AUTHORS = {
    name: value
    for name, value in DDPGSettings.bases["figure8"].items()
    if name.startswith("normalize")
}


def statistics(changes, seeds=1):
    """Statistics of observations of four numbers."""
    settings = algorithm_settings("ddpg", overrides={**RUNNING, **changes})
    return RunningStatistics(settings, seeds, 4, dtype=torch.float64, device=torch.device("cpu"))


def observations(*shape):
    """Four numbers of different scales, one of them nearly constant and far from 0."""
    scale, center = (1.0, 1e-3, 30.0, 0.05), (0.0, 2.0, -7.0, 0.0)
    normal = np.random.default_rng(4).normal(size=(*shape, 4))
    return (normal * scale + center).astype(np.float32)


@pytest.mark.parametrize(
    ("changes", "start", "floor", "epsilon"),
    [
        ({}, 1e-4, 0, 1e-8),
        (AUTHORS, 0.01, 0.1, 0),
        ({"normalize_start_count": 50, "normalize_min_sd": 0.02}, 50, 0.02, 1e-8),
    ],
)
def test_statistics_after_10000_control_steps_equal_numpy(changes, start, floor, epsilon):
    seen = observations(10_000 // 4, 2, 4)  # steps, seeds, environments
    running = statistics(changes, seeds=2)
    for i, rows in enumerate(seen):
        if i == 1234:
            states = [running.state(seed) for seed in range(2)]
            running = statistics(changes, seeds=2)
            for seed, state in enumerate(states):
                running.restore(seed, state)
        running.add(torch.from_numpy(rows))
    for seed in range(2):
        rows = seen[:, seed].reshape(-1, 4).astype(np.float64)
        count = start + len(rows)
        mean = rows.sum(axis=0) / count
        squares = ((rows - mean) ** 2).sum(axis=0) + start * (1 + mean**2)
        deviation = np.sqrt(np.maximum(squares / count, floor**2) + epsilon)
        shown = running.group_standardization(range(seed, seed + 1), is_stack=False)
        np.testing.assert_allclose(shown.mean[0].numpy(), mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(shown.deviation[0].numpy(), deviation, rtol=1e-12)


class Recorded(gymnasium.Env):
    """Shows recorded observations."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, rows):
        self._rows = iter(rows)

    def reset(self, *, seed=None, options=None):
        return next(self._rows), {}

    def step(self, action):
        return next(self._rows), 0.0, False, False, {}


def test_defaults_standardize_as_vec_normalize_of_stable_baselines3():
    seen, running = observations(50, 1), statistics({"normalize_clip": 10.0})
    env = VecNormalize(DummyVecEnv([lambda: Recorded(seen[:, 0])]), norm_reward=False)
    theirs = [env.reset(), *(env.step([[0.0]])[0] for _ in range(49))]
    ours = []
    for rows in seen:
        running.add(torch.from_numpy(rows[None]))
        ours.append(running.standardization().apply(torch.from_numpy(rows[None]).double())[0])
    np.testing.assert_allclose(torch.stack(ours).numpy(), theirs, rtol=1e-6, atol=1e-6)
    assert np.abs(theirs).max() < 10


@pytest.mark.parametrize("environments", [1, 5])
def test_observations_on_which_the_agent_acts_are_counted(environments):
    changes = {**RUNNING, "learning_starts": 1000}
    encoder = TanhEncoder(4)
    with build_engine(
        "ddpg", [3, 5], environments=environments, encoder=encoder, changes=changes
    ) as engine:
        seen = [engine.environments.observations.clone()]
        for _ in engine.learn(50 * environments):  # two and a half episodes
            seen.append(engine.environments.observations.clone())
        state = engine.state(1).tensors
    # Not the one after the last step, and of episodes not the last ones, which are not among them.
    rows = torch.stack(seen[:-1])[:, 1].reshape(-1, 4).double()
    assert state["statistics/count"].item() == pytest.approx(1e-4 + len(rows), abs=1e-9)
    torch.testing.assert_close(
        state["statistics/mean"], rows.sum(dim=0) / (1e-4 + len(rows)), rtol=1e-12, atol=1e-12
    )


def fixed_standardization():
    """What standardizes 16 numbers, and the same by numpy."""
    random = np.random.default_rng(6)
    mean, deviation = random.normal(size=16), random.uniform(0.1, 2, 16)
    ours = Standardization(torch.from_numpy(mean), torch.from_numpy(deviation), 1.5)
    return ours, lambda seen: np.clip((seen.astype(np.float64) - mean) / deviation, -1.5, 1.5)


@pytest.mark.parametrize("algo", OFF_POLICY)
def test_off_policy_update_equals_stable_baselines3(algo, monkeypatch):
    automatic = {"target_entropy": "auto"} if algo == "sac" else {}
    settings, data = build_settings(algo, **automatic), transitions()
    agent = build_oracle(algo, settings, torch.float64, monkeypatch)
    _, learner = build_learner(algo, settings, torch.float64)
    copy_initial_parameters(algo, agent, learner)
    ours, theirs = fixed_standardization()
    fill(agent, data)
    agent.replay_buffer._normalize_obs = lambda seen, env: theirs(seen)
    for update in (1, 2):
        batch = next_batch(data, settings, learner.noise_per_transition, torch.float64, update)
        ours.apply_in_place(batch.observations)
        ours.apply_in_place(batch.next_observations)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        learner.update(batch, learner.is_delayed_update(update, 0))
    assert largest_difference(parameters(algo, agent, learner).values()) < 1e-10


def test_ppo_update_equals_stable_baselines3(monkeypatch):
    settings = build_settings("ppo", n_envs=2, n_steps=60, n_epochs=1, batch_size=120)
    agent = build_oracle("ppo", settings, torch.float64, monkeypatch)
    _, learner = build_learner("ppo", settings, torch.float64)
    copy_initial_parameters("ppo", agent, learner)
    rows = fill_rollout(agent, settings, transitions()).rows.flatten(0, 2).double()
    ours, theirs = fixed_standardization()
    ours.apply_in_place(rows[:, :SIZE])
    agent.rollout_buffer.observations = theirs(agent.rollout_buffer.observations)
    np.random.seed(3)
    agent.train()
    np.random.seed(3)
    learner.update(Transitions(rows[np.random.permutation(120)], 1))
    assert largest_difference(parameters("ppo", agent, learner).values()) < 1e-10


@pytest.mark.parametrize("algo", PLAIN)
def test_minibatches_are_mirrored_and_then_standardized_by_the_newest_statistics(algo):
    rows, images = (encoded(None, *part) for part in replay_rows())
    changes = {**RUNNING, "mirror": True, "tau": 0.1, "batch_size": 15}
    with build_engine(algo, [3], changes=changes, dtype=torch.float64) as engine:
        engine.replay.restore(0, rows[None], ROWS)
        # The statistics change after the rows were stored; images are not counted.
        engine._statistics.add(rows[None, :3, :16])
        state = engine._statistics.state(0)
        assert state["count"] == pytest.approx(3 + 1e-4)
        deviation = (state["variance"] + 1e-8).sqrt()
        for seen in (rows, images):
            seen[:, :16] = ((seen[:, :16] - state["mean"]) / deviation).clamp(-5, 5)
        assert_updates_equal_autograd(algo, engine, rows, images)


def test_rollouts_of_ppo_hold_what_the_policy_saw():
    """Otherwise its likelihoods would not be those of the stored actions."""
    with build_engine("ppo", [2], changes=RUNNING, dtype=torch.float64) as engine:
        learner, settings = engine.learners[0], engine._settings
        for _ in engine.learn(settings.n_steps * settings.n_envs):
            if engine._collected == settings.n_steps:
                break
        batch = Transitions(engine._rollout.rows[0].flatten(0, 1), action_size=1)
        means, values = learner._forward(batch.observations)
        expected = torch.distributions.Normal(means, learner.log_sigma.exp())
        torch.testing.assert_close(batch.log_likelihoods, expected.log_prob(batch.actions))
        torch.testing.assert_close(batch.values, values)
        assert batch.observations.abs().max() <= 10


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        ("ddpg", {"changes": AUTHORS}),
        slow("td3", {**NORMALIZED, "environments": 2}),
        ("sac", {**NORMALIZED, "encoder": TanhEncoder()}),
        ("ppo", NORMALIZED),
        slow("td3", {"changes": {**RUNNING, "mirror": True}, "precision": "bfloat16"}),
    ],
)
def test_seed_is_independent_of_other_seeds_bit_for_bit(algo, options):
    assert_independent(lambda seeds: build_engine(algo, seeds, **options))


def build_tqc(seeds, **options):
    settings = TQC_SETTINGS.model_copy(update=RUNNING)
    return short_engine(TQC, settings, "face_direction", seeds, **options)


@pytest.mark.parametrize(
    ("algo", "stop"), [("ddpg", 40), slow("td3", 43), slow("sac", 45), ("ppo", 49)]
)
def test_restored_engine_continues_bit_for_bit(algo, stop):
    assert_continues(lambda seeds: build_engine(algo, seeds, **NORMALIZED), stop)


def test_rule_of_another_package_is_standardized():
    with build_tqc([0, 1]) as engine:
        list(engine.learn(STEPS))
        assert_policies_equal_agents(engine)
        assert [layer.kind for layer in engine.policy(0).layers[:3]] == ["shift", "divide", "clip"]
    assert_loads(build_tqc)


@pytest.mark.parametrize("algo", ["td3", slow("ddpg"), slow("sac"), "ppo"])
def test_seed_in_stack_equals_single_seed(algo):
    options = {"dtype": torch.float64, **NORMALIZED}
    with build_engine(algo, [0, 4], stacked=True, **options) as engine:
        list(engine.learn(STEPS))
        state = engine.state(1)
    with build_engine(algo, [4], **options) as single:
        list(single.learn(STEPS))
        expected = single.state(0)
    for name, tensor in expected.tensors.items():
        torch.testing.assert_close(state.tensors[name], tensor, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_loaded_policy_equals_agent_bit_for_bit(algo):
    assert_loads(lambda seeds: build_engine(algo, seeds, **NORMALIZED))


def test_statistics_are_loaded_with_a_policy():
    changes = {"changes": AUTHORS}
    with (
        build_engine("ddpg", [0], **changes) as engine,
        build_engine("ddpg", [9], **changes) as new,
    ):
        list(engine.learn(STEPS))
        new.load_policy(0, engine.policy(0), engine.control_steps)
        before, after = engine._statistics, new._statistics
        assert after.count == pytest.approx(before.count)
        np.testing.assert_allclose(after.mean, before.mean, rtol=1e-6, atol=1e-9)
        least = np.maximum(before.variance, 0.1**2)
        np.testing.assert_allclose(after.variance, least, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_exported_model_acts_as_the_agent(algo, tmp_path):
    with build_engine(algo, [0, 1], **NORMALIZED) as engine:
        list(engine.learn(STEPS))
        assert_policies_equal_agents(engine)
        policy = SavedNetwork.from_files(*engine.policy(0).files().values())
        path = tmp_path / "agent.onnx"
        export_onnx(TrainedAgent("face_direction", policy, None), "run", path, in_si_units=False)
        seen = np.random.default_rng(0).uniform(-1, 1, (2, 20, 16)).astype(np.float32)
        np.testing.assert_allclose(run_model(path, seen[0]), engine.act(seen)[0], atol=1e-6)


def test_learned_features_and_constants_are_refused():
    features = {"ofe": OFESettings(units=12), "representation": "ofe12", "engine": "batched"}
    features |= {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 1}
    with pytest.raises(ValueError, match="ofe12 standardizes its inputs itself: normalize must be"):
        small_run("td3", RUNNING, **features)
    with pytest.raises(RequestError, match="one of them must be above 0"):
        algorithm_settings("sac", overrides={**RUNNING, "normalize_epsilon": 0.0})
    with pytest.raises(RequestError, match="figure8 are for ddpg, not for td3; choose published"):
        algorithm_settings("td3", "figure8")


def test_settings_of_figure8_are_those_of_the_earlier_script(tmp_path):
    about = {"task": "face_direction", "algo": "ddpg", "encoder": "none", "seeds": [0]}
    about |= {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 1}
    about["overrides"] = {}
    script, run, bootstrapped = (
        request_runs(Results(tmp_path), base=base, **about, **typed)[0]
        for base, typed in (
            ("script", {}),
            ("figure8", {}),
            ("figure8", {"time_limit": "bootstrap"}),
        )
    )
    changed = {
        name: value
        for name, value in run.hyperparameters.items()
        if script.hyperparameters.get(name) != value
    }
    assert changed == {
        "hidden_layers": [300, 300, 300],
        "batch_size": 64,
        "learning_starts": 64,
        "normalize": "running",
        "normalize_min_sd": 0.1,
        "normalize_epsilon": 0.0,
        "normalize_start_count": 0.01,
    }
    assert (run.first_update, run.algorithm.normalize_clip) == (100, 5)
    limits = [each.time_limit for each in (script, run, bootstrapped)]
    assert limits == ["bootstrap", "terminal", "bootstrap"]
