"""Tests of policies from the files of stable-baselines3."""

import io
import json
import warnings
import zipfile

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from jbench.cli import main
from jbench.errors import RequestError, WorkWarning
from jbench.policies.actors import acting
from jbench.policies.sb3_zip import read_sb3_zip, recorded_name
from jbench.settings.records import EvaluationSettings
from jbench.store.manifest import ID
from jbench.tasks.find import find_task

FACE = "face_direction"
PENDULUM = "gym:Pendulum-v1"


def leaning_pendulum():
    """Its torque of -2 to 2 is asked for by actions in [-0.1, 0.3]."""
    return gymnasium.wrappers.RescaleAction(gymnasium.make("Pendulum-v1"), *np.float32([-0.1, 0.3]))


LEANING = f"{__name__}:leaning_pendulum"


@pytest.fixture
def save(tmp_path):
    """Returns a function that saves a model and returns it, with the path of its file."""

    def made(algorithm, policy="MlpPolicy", **settings):
        env = gymnasium.make("jbench:Jitterbug/FaceDirection-v0")
        model = algorithm(policy, env, seed=0, device="cpu", **settings)
        path = tmp_path / f"{algorithm.__name__.lower()}.zip"
        model.save(path)
        return model, str(path)

    return made


def replace_weights(path, weights):
    """Replaces the weights in the file of a model."""
    content = io.BytesIO()
    torch.save(weights, content)
    with zipfile.ZipFile(path) as old:
        data = old.read("data")
    with zipfile.ZipFile(path, "w") as new:
        new.writestr("data", data)
        new.writestr("policy.pth", content.getvalue())


@pytest.mark.parametrize(
    ("algorithm", "kwargs"),
    [
        (TD3, {}),
        (DDPG, {"net_arch": [8], "activation_fn": torch.nn.SiLU}),
        (SAC, {}),
        (SAC, {"net_arch": []}),
        (PPO, {}),
        (PPO, {"net_arch": []}),
        (PPO, {"net_arch": [32, 16], "activation_fn": torch.nn.ELU}),
        (A2C, {"activation_fn": torch.nn.LeakyReLU}),
    ],
)
def test_actions_are_those_of_the_model(save, algorithm, kwargs):
    model, path = save(algorithm, policy_kwargs=kwargs)
    observations = np.random.default_rng(0).normal(size=(50, 16)).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    found = read_sb3_zip(path, FACE).act(observations)
    assert np.ptp(wanted) > 1e-3
    np.testing.assert_allclose(found, wanted, atol=1e-5)


@pytest.mark.parametrize("algorithm", [PPO, A2C, SAC, TD3])
@pytest.mark.parametrize(
    ("make", "task"),
    [(leaning_pendulum, LEANING), (lambda: gymnasium.make("Pendulum-v1"), PENDULUM)],
)
def test_commands_are_the_actions_of_a_model_of_the_environment_itself(
    algorithm, make, task, tmp_path
):
    model = algorithm("MlpPolicy", make(), seed=0, device="cpu")
    model.save(tmp_path / "model.zip")
    observations = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    actions = read_sb3_zip(str(tmp_path / "model.zip"), task).act(observations)
    assert np.ptp(wanted) > 1e-3
    np.testing.assert_allclose(find_task(task).commands(actions), wanted, atol=1e-6)


def test_torque_of_a_model_of_the_pendulum(tmp_path):
    """An action of 1 is half of the largest torque, 2, and one of 9 the largest."""
    model = PPO("MlpPolicy", gymnasium.make("Pendulum-v1"), seed=0, device="cpu")
    torch.nn.init.zeros_(model.policy.action_net.weight)
    for torque, action in ((1.0, 0.5), (9.0, 1.0), (-9.0, -1.0)):
        torch.nn.init.constant_(model.policy.action_net.bias, torque)
        model.save(tmp_path / "model.zip")
        network = read_sb3_zip(str(tmp_path / "model.zip"), PENDULUM)
        assert network.act(np.zeros((1, 3), np.float32)).tolist() == [[action]]


def test_model_of_jbenchs_environment_acts_as_before(tmp_path):
    env = gymnasium.wrappers.RescaleAction(gymnasium.make("Pendulum-v1"), -1, 1)
    PPO("MlpPolicy", env, device="cpu").save(tmp_path / "model.zip")
    assert len(read_sb3_zip(str(tmp_path / "model.zip"), PENDULUM).layers) == 5


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_model_with_other_bounds_than_the_task_is_refused(algorithm, tmp_path):
    model = algorithm("MlpPolicy", gymnasium.make("Pendulum-v1"), device="cpu")
    path = str(tmp_path / "model.zip")
    model.save(path)
    with pytest.raises(RequestError, match=r"actions in \[-2, 2\], but those .* \[-0.1, 0.3\]; "):
        read_sb3_zip(path, LEANING)

    with zipfile.ZipFile(path) as old:
        content = {name: old.read(name) for name in old.namelist()}
    data = json.loads(content["data"])
    data["action_space"]["low"] = "[-2. ... -2.]"
    content["data"] = json.dumps(data)
    with zipfile.ZipFile(path, "w") as new:
        for name, part in content.items():
            new.writestr(name, part)
    with pytest.raises(RequestError, match="does not say between which bounds"):
        read_sb3_zip(path, PENDULUM)


def test_model_that_returns_commands_is_no_actor(tmp_path):
    model = PPO("MlpPolicy", gymnasium.make("Pendulum-v1"), device="cpu")
    for actor in (model, model.policy):
        with pytest.raises(RequestError, match=r"The model's actions are in Box\(-2.0, 2.0"):
            acting(actor, 1).__enter__()


@pytest.mark.slow
def test_file_is_evaluated_and_its_content_is_part_of_the_id(save, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    where = ("--episodes", "1", "--json", "--results", str(tmp_path / "results"))
    ids = []
    for width in (8, 16):
        _, path = save(TD3, policy_kwargs={"net_arch": [width]})
        assert main(["evaluate", path, *where]) == 0
        made = json.loads(capsys.readouterr().out)
        assert made["settings"]["policy"] == "td3.zip"
        ids.append(made["id"])
    assert all(id.startswith("face_direction/td3.zip/s00-") for id in ids)
    assert len(set(ids)) == 2
    assert main(["evaluate", "none.zip", *where]) == 2
    assert "none.zip can't be read (No such file or directory)." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("models/td3_best-1.zip", "td3_best-1.zip"),
        ("a:b,c=d.zip", "a:b,c=d.zip"),  # characters that ids have a point for
        ("my model (1).zip", "my-model--1-.zip"),
        ("\u6a21\u578b.zip", "model.zip"),
        ("..zip", "model.zip"),
        ("-x.zip", "x.zip"),
        ("x" * 200 + ".zip", "x" * 96 + ".zip"),
    ],
)
def test_file_of_any_name_can_be_evaluated(path, name):
    assert recorded_name(path) == name
    settings = EvaluationSettings(task=FACE, policy=name)
    assert ID.fullmatch(settings.id)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"use_sde": True}, "it explores with gSDE; load the model in a module of yours"),
        ({"policy_kwargs": {"activation_fn": torch.nn.Softplus}}, "its activation Softplus is not"),
    ],
)
def test_policy_that_is_no_known_sequence_of_layers_is_refused(save, settings, message):
    _, path = save(PPO, **settings)
    with pytest.raises(RequestError, match=message):
        read_sb3_zip(path, FACE)


@pytest.mark.parametrize("is_normalized", [True, False])
def test_warning_says_that_statistics_of_observations_are_not_in_the_file(is_normalized, tmp_path):
    env = DummyVecEnv([lambda: gymnasium.make("jbench:Jitterbug/FaceDirection-v0")])
    if is_normalized:
        env = VecNormalize(env)

    model = PPO("MlpPolicy", env, device="cpu", n_steps=2, batch_size=2)
    model._setup_learn(2)  # as `learn` begins
    model.save(tmp_path / "ppo.zip")
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", WorkWarning)
        read_sb3_zip(str(tmp_path / "ppo.zip"), FACE)

    said = [str(each.message) for each in found if each.category is WorkWarning]
    assert len(said) == is_normalized
    assert all("with a VecNormalize, whose statistics are not in the file" in one for one in said)


def test_model_of_another_task_is_refused(save):
    _, path = save(TD3)
    with pytest.raises(RequestError, match=r"1 output, but move_to_pose .*; use --task face_d"):
        read_sb3_zip(path, "move_to_pose")


def test_other_files_are_refused(tmp_path):
    text, empty = tmp_path / "text.zip", tmp_path / "empty.zip"
    text.write_text("no zip")
    zipfile.ZipFile(empty, "w").close()
    for path in (text, empty):
        with pytest.raises(RequestError, match="is no saved model of stable-baselines3"):
            read_sb3_zip(str(path), FACE)


def test_file_that_cannot_be_read_is_not_called_another_file(tmp_path):
    with pytest.raises(RequestError) as refused:
        read_sb3_zip(str(tmp_path / "none.zip"), FACE)
    sentence = f"{tmp_path / 'none.zip'} can't be read (No such file or directory)."
    assert str(refused.value) == sentence


def test_damaged_file_is_refused(tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("data", "{}" * 100)
    whole = content.getvalue()
    local = whole.index(b"PK\x03\x04")
    central = whole.index(b"PK\x01\x02")

    # Offsets from the beginning of the local entry, and of the entry in the directory.
    encrypted = bytearray(whole)
    encrypted[local + 6] |= 1
    encrypted[central + 8] |= 1
    compressed_otherwise = bytearray(whole)
    compressed_otherwise[local + 8] = 98
    compressed_otherwise[central + 10] = 98
    corrupt = bytearray(whole)
    corrupt[local + 34] = 0xFF  # the first byte after a header of 30 and the name of 4

    damaged = {
        "encrypted, password required": encrypted,
        "compression method is not supported": compressed_otherwise,
        "while decompressing data": corrupt,
    }
    path = tmp_path / "damaged.zip"
    for says, changed in damaged.items():
        path.write_bytes(changed)
        with pytest.raises(RequestError, match=rf"is no saved model of stable-.* \(.*{says}"):
            read_sb3_zip(str(path), FACE)


def test_weights_that_are_no_dictionary_of_tensors_are_refused(save):
    _, path = save(TD3)
    for weights in ([1], {"actor.mu.0.weight": 1, "actor.mu.0.bias": 1}, {1: torch.zeros(2)}):
        replace_weights(path, weights)
        with pytest.raises(RequestError, match="is no saved model of stable-baselines3"):
            read_sb3_zip(path, FACE)


def changed_weights(path, change):
    """Changes the weights in the file of a model."""
    with zipfile.ZipFile(path) as file:
        weights = torch.load(io.BytesIO(file.read("policy.pth")))
    change(weights)
    replace_weights(path, weights)


def test_model_of_a_training_that_diverged_is_refused(save):
    """MuJoCo ignores actions that are not finite, so its returns would be those of no policy."""
    for value in (np.nan, np.inf):
        _, path = save(TD3)
        changed_weights(path, lambda weights: weights["actor.mu.0.bias"].fill_(value))  # noqa: B023
        with pytest.raises(RequestError, match="not finite, as of a training that diverged; name"):
            read_sb3_zip(path, FACE)


def test_layers_that_do_not_fit_or_are_not_linear_are_refused(save):
    _, path = save(TD3)
    changed_weights(path, lambda weights: weights.update({"actor.mu.2.weight": torch.ones(1, 5)}))
    with pytest.raises(RequestError, match="is no saved model of stable-baselines3"):
        read_sb3_zip(path, FACE)

    normalizing = {"actor.mu.1.weight": torch.ones(8), "actor.mu.1.bias": torch.ones(8)}
    changed_weights(path, lambda weights: weights.update(normalizing))
    with pytest.raises(RequestError, match="it has other layers than linear ones; load the model"):
        read_sb3_zip(path, FACE)


def test_weights_of_another_precision_are_read(save):
    model, path = save(TD3)
    model.policy.to(torch.bfloat16)
    model.save(path)
    wanted = model.policy.actor.mu[0].weight.detach().float().numpy()
    np.testing.assert_array_equal(read_sb3_zip(path, FACE).layers[0].weight, wanted)


def test_no_object_in_the_file_is_unpickled(save, tmp_path):
    _, path = save(TD3)

    class Evil:
        def __reduce__(self):
            return (tmp_path.joinpath("ran").touch, ())

    replace_weights(path, {"actor.mu.0.weight": Evil()})
    with pytest.raises(RequestError, match="is no saved model"):
        read_sb3_zip(path, FACE)
    assert not (tmp_path / "ran").exists()
