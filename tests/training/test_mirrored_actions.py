"""Tests that every robot gets the actions that an encoder has mirrored: in training, evaluations,
saved and exported policies, Gymnasium's environment, and recorded runs."""

from contextlib import closing
from types import SimpleNamespace

import gymnasium
import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

import jbench
from jbench.agents.environments import Environments
from jbench.encoders.kinds.planar import HeadingFrame, PlanarMirror, PlanarReduction
from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.encoders.wrapper import EncodedObservation
from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.policies.onnx_export import export_onnx
from jbench.policies.saved import TrainedAgent, load_agent
from jbench.registration import environment_id
from jbench.store import Results
from jbench.tasks.jitterbug.features import mirrored, observation_size
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.repeat import reevaluate, retrain
from tests.agents.test_batched_engine import build_engine
from tests.agents.test_plugin_engine import build_engine as plugin_engine_of
from tests.encoders.encoder_data import make_dataset, planar_encoder
from tests.short_encoders import short_encoder_evaluation
from tests.short_episodes import EPISODE, short_episodes
from tests.training.small_runs import small_run, train

TASK = "face_direction"
OFF_POLICY = {"batch_size": 8, "train_freq": 10, "gradient_steps": 2, "learning_starts": 10}
LENGTHS = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A results directory with a planar-mirror encoder of random states, and the encoder's id."""
    results = Results(tmp_path_factory.mktemp("mirrored") / "results")
    dataset = make_dataset(results)
    settings = encoder_settings("planar-mirror", {}, dataset=dataset.id, latents=12)
    with short_encoder_evaluation():
        train_encoder(settings, States(dataset, TASK, 0), results)
    return results, settings.id


@pytest.fixture(scope="module", autouse=True)
def _short_episodes(results):
    with short_episodes():
        yield


def environments(*encoders):
    """Two seeds with three environments, always with the same generators."""
    return Environments(TASK, (0, 1), 3, encoders, episode_steps=15)


def test_robots_in_training_get_negated_actions_where_target_is_on_right():
    random = np.random.default_rng(0)
    with (
        closing(environments(None, None)) as robots,
        closing(
            environments(planar_encoder(TASK, PlanarReduction), planar_encoder(TASK, PlanarMirror))
        ) as agents,
    ):
        signs = []
        for step in range(40):
            if step == 20:
                agents.restore(1, agents.state(1))
            actions = random.uniform(-1, 1, (2, 3)).astype(np.float32)
            signs.append(np.sign(robots.observations.numpy()[1, :, 15]))  # the angle to the target
            taken = np.stack([actions[0], signs[-1] * actions[1]])
            rewards = robots.step(taken[..., None]).rewards
            np.testing.assert_array_equal(agents.step(actions[..., None]).rewards, rewards)
        assert set(np.ravel(signs)) == {-1, 1}


@pytest.mark.parametrize("kind", [PlanarReduction, HeadingFrame, PlanarMirror])
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("count", [1, 3])
def test_seeds_that_share_encoder_have_inputs_and_signs_of_seeds_alone(task, kind, count):
    encoder = planar_encoder(task, kind)
    with closing(Environments(task, range(7), count, [encoder] * 7)) as robots:
        seen = torch.from_numpy(
            np.random.default_rng(0).uniform(-1, 1, (7, count, observation_size(task)))
        ).float()
        assert torch.equal(robots.encode(seen), torch.stack([*map(encoder.encode, seen)]))
        alone = np.ones((7, count, 1))
        if kind is PlanarMirror:
            alone = [encoder.action_signs(rows).numpy() for rows in seen]
            assert np.ptp(alone) == 2
        np.testing.assert_array_equal(robots.action_signs(seen), alone)


@pytest.fixture(scope="module")
def policy():
    """A trained agent, 200 observations of the task, and its engine's actions for them."""
    encoder = planar_encoder(TASK, PlanarMirror)
    observations = np.random.default_rng(1).uniform(-1, 1, (200, 16)).astype(np.float32)
    with build_engine("td3", [3], encoder=encoder) as engine:
        list(engine.learn(64))
        actions = engine.act(observations[None])[0]
        agent = TrainedAgent(TASK, engine.policy(0), encoder)
    return SimpleNamespace(agent=agent, observations=observations, actions=actions)


@pytest.mark.slow
def test_saved_and_exported_policies_act_as_in_training(policy, tmp_path):
    found = policy.agent.act(policy.observations)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, policy.actions, atol=2e-6)
    # Actions of mirror images are the negated ones, and none is near 0.
    images = mirrored(TASK, policy.observations)
    np.testing.assert_allclose(policy.agent.act(images), -found, atol=1e-4)
    assert np.abs(found).max() > 0.1
    export_onnx(policy.agent, "a/run", tmp_path / "policy.onnx", in_si_units=False)
    session = onnxruntime.InferenceSession(str(tmp_path / "policy.onnx"))
    (exported,) = session.run(["action"], {"observation": policy.observations})
    np.testing.assert_allclose(exported, policy.actions, atol=2e-5)


def test_wrapped_environment_negates_actions_where_target_is_on_right(policy):
    plain = gymnasium.make(environment_id(TASK))
    wrapped = EncodedObservation(gymnasium.make(environment_id(TASK)), policy.agent.encoder)
    signs = []
    for target in (1.0, -1.0):
        seen, _ = plain.reset(seed=4, options={"target": target})
        wrapped.reset(seed=4, options={"target": target})
        for step in range(30):
            action = np.array([np.sin(1 + step)])
            signs.append(np.sign(seen[15]))
            seen, expected, *_ = plain.step(signs[-1] * action)
            assert wrapped.step(action)[1] == expected
    assert set(signs) == {-1, 1}


def test_agent_of_other_package_acts_for_robot(policy):
    with plugin_engine_of(encoder=policy.agent.encoder) as engine:
        images = mirrored(TASK, policy.observations)
        actions = engine.act(policy.observations[None])
        assert np.abs(actions).max() > 0.1
        np.testing.assert_allclose(engine.act(images[None]), -actions, atol=1e-4)


@pytest.mark.parametrize("engine", ["batched", "sb3"])
def test_last_evaluation_of_run_is_repeated(engine, results):
    """By the engine bit for bit, and by the saved policy, which rounds differently."""
    results, encoder = results
    about = {"engine": engine, "seed": 1, "representation": "planar-mirror12", **LENGTHS}
    run = small_run("td3", OFF_POLICY, encoder=encoder, **about)
    record = train(run, results)
    again = reevaluate(results, record)
    assert (again.verdict, again.reason) == ("equal", "")
    assert np.ptp(again.recorded) > 0.1
    if engine == "batched":
        act, number = load_agent(results, record.id).act, LENGTHS["steps"] // EPISODE - 1
        (made,) = evaluate_policies(run, [derive_seeds(run.seed).evaluations], number, act)
        np.testing.assert_allclose(made.returns, again.recorded, atol=1e-2)


def test_recorded_runs_on_mirrored_observations(results):
    results, encoder = results
    actor = nn.Sequential(nn.Linear(12, 1), nn.Tanh())
    about = {"algo": "mine", "seed": 7, "hyperparameters": {}, "encoder": encoder, **LENGTHS}
    with jbench.record(TASK, results=results.path, **about) as recording:
        env = recording.env()
        for _ in range(2):
            env.reset()
            for step in range(EPISODE):
                env.step(np.array([np.sin(step / 5)], np.float32))
        recording.keep_policy(actor)
    record = results.find("run", recording.id)
    assert reevaluate(results, record).verdict == "equal"
    with pytest.raises(RequestError, match="only its evaluation can be repeated; type --episodes"):
        retrain(results, record, 1)
