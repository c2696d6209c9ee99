"""Tests of the export of policies to ONNX, against ONNX Runtime."""

import json
import os

import gymnasium
import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from jbench.cli import main
from jbench.datasets.observations import observations_schema
from jbench.encoders.kind import Learned
from jbench.encoders.registry import kind_names, latent_sizes, make_kind
from jbench.encoders.saved import SavedEncoder
from jbench.errors import RequestError
from jbench.policies import layers
from jbench.policies.layer_sequences import feature_layers, relu_layers
from jbench.policies.layers import (
    Clip,
    Elu,
    LayerNorm,
    LeakyRelu,
    Linear,
    Relu,
    Scale,
    Shift,
    Sigmoid,
    Silu,
    Tanh,
)
from jbench.policies.network import SavedNetwork
from jbench.policies.onnx_export import export_onnx
from jbench.policies.saved import TrainedAgent
from jbench.settings.base import settings_hash
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.tasks.jitterbug import features
from jbench.tasks.task import episode_generator, rollout
from tests.encoders.encoder_data import fitted_encoder, make_dataset, observations_of, read_states
from tests.gym_tasks import EPISODE as EPISODE_OF_CART
from tests.gym_tasks import cart
from tests.short_episodes import EPISODE, shorten_episodes

TASK = "face_direction"
RUN = "reference/face_direction/ddpg/full"
PRECISION = 2e-5  # of an action in float32, whose sums have another order


def run_model(path, inputs):
    """The output of a model in ONNX Runtime."""
    session = onnxruntime.InferenceSession(str(path))
    return session.run(["action"], {"observation": np.asarray(inputs, np.float32)})[0]


def random_matrix(*shape):
    return np.random.default_rng(len(shape)).normal(size=shape).astype("f4")


def build_policy(inputs, actions=1):
    """A policy with two layers."""
    hidden, bias = random_matrix(8, inputs) / inputs, random_matrix(8)
    output = Linear(weight=random_matrix(actions, 8), bias=random_matrix(actions))
    layers = [Linear(weight=hidden, bias=bias), output]
    return SavedNetwork(relu_layers(layers, "tanh"))


@pytest.mark.parametrize("lacking", ["task", "encoder"])
def test_run_whose_settings_lack_what_its_policy_needs_is_refused(lacking, tmp_path, refused):
    policy, results = build_policy(16), Results(tmp_path / "results")
    settings = {"task": "face_direction", "encoder": None, "seed": 0}
    del settings[lacking]
    id = f"face_direction/other/full/s00-{settings_hash(settings)}"
    results.create("run", id, settings).finish({}, policy.files())
    error = refused("export", id, results=results.path, code=1)
    assert error == f"Error: The settings of the run {id} lack a task or an encoder.\n"


@pytest.mark.slow
def test_exported_policy_repeats_actions_of_evaluation(tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    results = tmp_path / "results"
    where = ("--results", str(results))
    evaluate = ("evaluate", RUN, "--episodes", "1", "--seed", "5", "--states")
    assert main([*evaluate, *where]) == 0
    assert main(["export", RUN, "--out", str(tmp_path / "policy.onnx"), *where]) == 0
    (record,) = Results(results).scan("evaluation")[0]
    states = record.read("policy_states")
    recorded = states["action"].to_numpy().reshape(EPISODE, 1, 1)
    # Replaying the recorded actions must reproduce the return of the evaluation.
    seen, episode_return, actions = [], 0.0, iter(recorded)

    def replay(observations):
        seen.append(observations[0])
        return next(actions)

    with find_task(TASK).worlds(1) as worlds:
        observations = worlds.reset([episode_generator(5, 0)])
        for transition in rollout(worlds, observations, replay):
            episode_return += transition.rewards[0]
    (evaluated,) = record.read("policy_episodes").to_pylist()
    assert episode_return == evaluated["episode_return"] > 1
    exported = run_model(
        tmp_path / "policy.onnx", features.denormalize(TASK, np.array(seen[:EPISODE]))
    )
    assert np.abs(recorded[:, 0]).mean() > 0.1
    np.testing.assert_allclose(exported, recorded[:, 0], atol=PRECISION)


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """Random states of a synthetic dataset, scaled."""
    results = Results(tmp_path_factory.mktemp("onnx") / "results")
    return read_states(make_dataset(results))


def make_encoder(name, states):
    """An encoder with initial weights, or fitted weights if its kind is not trained."""
    kind = make_kind(name, {})
    sizes = latent_sizes(name, TASK)
    latents = sizes[0] if len(sizes) == 1 else 3
    if not isinstance(kind, Learned):
        return fitted_encoder(kind, states, latents)
    weights = kind.initial(states.size, latents, torch.Generator().manual_seed(0))
    weights = {name: value.numpy() for name, value in weights.items()}
    return SavedEncoder(kind, weights, states.scaling, latents)


@pytest.mark.parametrize(
    "kind",
    [
        kind if kind == "dae" else pytest.param(kind, marks=pytest.mark.slow)
        for kind in kind_names()
    ],
)
def test_encoder_is_part_of_model(kind, states, tmp_path):
    encoder = make_encoder(kind, states)
    agent = TrainedAgent(TASK, build_policy(encoder.latent_size), encoder)
    export_onnx(agent, "run", tmp_path / "policy.onnx", in_si_units=True)
    observations = observations_of(states.dataset)[0, ::100]
    actions = run_model(tmp_path / "policy.onnx", features.denormalize(TASK, observations))
    assert np.ptp(actions) > 1e-3
    np.testing.assert_allclose(actions, agent.act(observations), atol=PRECISION)


def linear(outputs, inputs):
    return Linear(weight=random_matrix(outputs, inputs), bias=np.zeros(outputs, "f4"))


LAYERS = [
    Scale(factor=np.full(16, 0.5, "f4")),
    Shift(offset=np.full(16, 0.1, "f4")),
    Clip(low=-0.4, high=0.5),
    linear(8, 16),
    LayerNorm(weight=random_matrix(8), bias=random_matrix(8), epsilon=1e-5),
    Silu(),
    Tanh(),
    Sigmoid(),
    Relu(),
    Elu(alpha=1.5),
    LeakyRelu(slope=0.1),
    linear(1, 8),
]
POLICIES = {
    "a recorded network": SavedNetwork(LAYERS),
    "features learned with the agent": SavedNetwork(
        [
            *feature_layers(np.zeros(16, "f4"), np.full(16, 2, "f4"), [linear(5, 16)], True),
            linear(1, 21),
        ]
    ),
}


def test_every_kind_of_layer_is_in_a_tested_policy():
    tested = {layer.kind for policy in POLICIES.values() for layer in policy.layers}
    assert tested == set(layers.LAYERS)


@pytest.mark.parametrize("policy", POLICIES.values(), ids=POLICIES)
def test_every_layer_type_is_exported(policy, tmp_path):
    path = tmp_path / "policy.onnx"
    agent = TrainedAgent(TASK, policy, None)
    export_onnx(agent, "run", path, in_si_units=False)
    observations = np.random.default_rng(5).uniform(-1, 1, (50, 16)).astype("f4")
    actions = run_model(path, observations)
    assert np.ptp(actions) > 0.1
    np.testing.assert_allclose(actions, agent.act(observations), atol=PRECISION)
    # Inputs that are not in SI units have the bounds by which they are scaled.
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    motor_velocity = {"name": "motor_velocity", "unit": "rad/s", "minimum": -180, "maximum": 180}
    assert json.loads(properties["inputs"])[14] == motor_velocity


def test_metadata_has_names_and_units_of_inputs_and_outputs(tmp_path):
    path = tmp_path / "policy.onnx"
    agent = TrainedAgent("move_to_pose", build_policy(19), None)
    export_onnx(agent, "a/run", path, in_si_units=True)
    model = onnx.load(path)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    inputs = json.loads(properties["inputs"])
    assert inputs[0] == {"name": "position_x", "unit": "m"}
    assert inputs[-1] == {"name": "angle_to_target", "unit": "rad"}
    assert [feature["unit"] for feature in inputs] == (
        ["m"] * 3 + ["1"] * 4 + ["m/s"] * 3 + ["rad/s"] * 3 + ["rad", "rad/s"] + ["m"] * 3 + ["rad"]
    )
    (output,) = json.loads(properties["outputs"])
    assert (output["unit"], output["minimum"], output["maximum"]) == ("1", -1, 1)
    assert (properties["task"], properties["run"]) == ("move_to_pose", "a/run")
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "robots"
    assert b".py" not in path.read_bytes()  # no paths of this computer
    assert json.loads(properties["control_timestep"]) == {"value": 0.01, "unit": "s"}


def test_policy_of_another_robot_has_its_observation_and_all_its_motors(tmp_path):
    path = tmp_path / "policy.onnx"
    agent = TrainedAgent("dmc:fish-swim", build_policy(24, 5), None)
    export_onnx(agent, "a/run", path, in_si_units=False)
    observations = np.random.default_rng(5).normal(size=(50, 24)).astype("f4")
    actions = run_model(path, observations)
    assert actions.shape == (50, 5)
    np.testing.assert_allclose(actions, agent.act(observations), atol=PRECISION)
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    inputs = [feature["name"] for feature in json.loads(properties["inputs"])]
    # Joint angles, the height, the target, and velocities, as dm_control names them; the height is
    # one number, and has no index.
    assert inputs[6:9] == ["joint_angles_6", "upright", "target_0"]
    # As in a dataset, between the numbers of episode and step and the actions.
    assert inputs == observations_schema(find_task("dmc:fish-swim")).names[2:26]
    bounds = {"minimum": -1, "maximum": 1, "actuator_minimum": -1, "actuator_maximum": 1}
    assert json.loads(properties["outputs"])[4] == {"name": "action_4", **bounds}
    assert json.loads(properties["control_timestep"]) == {"value": 0.04, "unit": "s"}
    with pytest.raises(
        RequestError, match="dmc:fish-swim are not known: type --inputs observation"
    ):
        export_onnx(agent, "a/run", path, in_si_units=True)


@pytest.mark.slow
def test_model_controls_an_environment_without_jbench(tmp_path):
    """By the program of docs/your-own-robot.md: a Dict observation, and actions in [-2, 4]."""
    path = tmp_path / "policy.onnx"
    agent = TrainedAgent("tests.gym_tasks:cart", build_policy(4, 1), None)
    export_onnx(agent, "a/run", path, in_si_units=False)
    properties = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    (motor,) = json.loads(properties["outputs"])
    low, high = motor["actuator_minimum"], motor["actuator_maximum"]
    assert (low, high) == (-2, 4)
    env = cart()
    seed = int(np.random.default_rng(0).integers(2**32))  # by which jbench seeds the episode
    observation, _ = env.reset(seed=seed)
    with find_task(agent.task).worlds(1) as worlds:
        observed = worlds.reset([np.random.default_rng(0)])
        for _ in range(EPISODE_OF_CART):
            numbers = gymnasium.spaces.flatten(env.observation_space, observation)
            np.testing.assert_allclose(numbers, observed[0], atol=1e-5)
            action = low + (run_model(path, numbers[np.newaxis])[0] + 1) / 2 * (high - low)
            observation, reward, *_ = env.step(action.reshape(1, 1))
            observed, rewards = worlds.step(agent.act(observed))
            np.testing.assert_allclose(reward, rewards[0], atol=1e-4)


class SortingEncoder:
    """Sorts the observation, which no layer can do."""

    latent_size = 16

    def encode(self, batch):
        return np.sort(batch, axis=-1)


def test_encoder_that_is_not_layers_is_refused(tmp_path):
    agent = TrainedAgent(TASK, build_policy(16), SortingEncoder())
    with pytest.raises(RequestError, match="The run a/b can't be exported to ONNX"):
        export_onnx(agent, "a/b", tmp_path / "policy.onnx", in_si_units=True)
    assert not (tmp_path / "policy.onnx").exists()


def test_device_is_not_replaced(tmp_path, refused):
    """A pipe stands for a device such as /dev/null."""
    os.mkfifo(tmp_path / "pipe")
    error = refused("export", RUN, "--out", tmp_path / "pipe", results=tmp_path / "results")
    assert f"--out {tmp_path}/pipe is not a plain file; name a file." in error
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--format", "onnx"), "type jbench export RUN"),
        (("a/b", "--format", "minari"), "RUN is not for minari, which has --dataset"),
        (("a/b", "--task", TASK), "--task is not for onnx"),
        (("a/b",), "There is no run a/b in"),
        (("a/b", "--out", "."), "--out . is a directory; name a file."),
    ],
)
def test_invalid_request_is_refused(arguments, message, tmp_path, refused):
    assert message in refused("export", *arguments, results=tmp_path)
