"""Tests of the training of encoders: learning, saved files and resuming."""

import numpy as np
import pytest
import safetensors.numpy
import torch

from jbench.encoders import load_encoder
from jbench.encoders.kind import Learned
from jbench.encoders.kinds.autoencoders import Autoencoder, DenoisingAutoencoder
from jbench.encoders.kinds.linear import PrincipalComponents
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.saved import DESCRIPTION, WEIGHTS
from jbench.encoders.states import States, split_episodes
from jbench.encoders.training import CHECKPOINT, train_encoder
from jbench.errors import WorkError
from jbench.store import Results, schema
from jbench.tasks.find import find_task
from tests.encoders.encoder_data import (
    CHEAP,
    make_dataset,
    observations_of,
    random_states,
    rows,
    train,
)

STREAMED = 3 * 2 * 1001 * 16 * 4  # bytes of memory, enough for two episodes
LEARNED = {"dae": {}, "ddae": {"horizon": 3}, "vae": {"hidden": 8}, "lld-vae": {"hidden": 8}}
LEARNED["forward"] = {"hidden": 8, "horizon": 2}
LEARNED["contrastive"] = {"hidden": 8}
FAST = ("dae", "lld-vae")


def train_until(epoch, *arguments, **more):
    def stop(done):
        if done == epoch:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(*arguments, progress=stop, **more)


def files(record):
    return [record.read_file(name) for name in (WEIGHTS, DESCRIPTION)]


def test_every_row_is_used_once_per_epoch(trained):
    (shard,) = trained.states.learn()
    rows, seen = shard.states.view(-1, 16), []

    class Watching(Autoencoder):
        def gradient(self, weights, gradients, batch):
            seen.append(batch.now.clone())
            return super().gradient(weights, gradients, batch)

    EncoderLearner(Watching(batch=64), trained.states, 2).epoch()
    assert [len(batch) for batch in seen] == [64] * (4004 // 64) + [4004 % 64]
    found = torch.cat(seen)
    assert not torch.equal(found, rows)
    order = [np.lexsort(values.numpy().T) for values in (found, rows)]
    assert torch.equal(found[order[0]], rows[order[1]])


@pytest.mark.parametrize(
    ("kind", "commit_every"),
    [
        *(
            pytest.param(kind, 0.0, marks=() if kind in FAST else pytest.mark.slow)
            for kind in LEARNED
        ),
        ("dae", 1e9),
    ],
)
def test_interrupted_training_resumes_to_same_weights(trained, tmp_path, kind, commit_every):
    more = {"options": LEARNED[kind], "commit_every": commit_every}
    uninterrupted = train(trained.states, Results(tmp_path / "uninterrupted"), kind, **more)
    results = Results(tmp_path / "stopped")
    for stop in (1, 2):
        train_until(2 * stop, trained.states, results, kind, **more)
        (begun,) = results.scan("encoder")[0]
        assert begun.status == "unfinished"
        # A process commits its first epoch immediately, later ones at intervals.
        assert begun.rows("encoder_epochs") == (stop if commit_every else 2 * stop)
    seen = []
    done = train(trained.states, results, kind, progress=seen.append, **more)
    assert files(done) == files(uninterrupted)
    assert seen[0] > 0
    assert seen[-1] == 5
    reported = ["epoch", "train_loss", "test_mse", "test_denoising_mse"]
    assert rows(done)[reported].equals(rows(uninterrupted)[reported])
    assert rows(done)["wall_time"].is_monotonic_increasing
    assert CHECKPOINT not in done.roles()


def test_interrupted_streaming_training_resumes_to_same_weights(trained, tmp_path):
    dataset = make_dataset(Results(tmp_path / "data"), episodes=10, each=2)

    def streamed():
        return States(dataset, "face_direction", 2, memory=STREAMED)

    uninterrupted = train(streamed(), Results(tmp_path / "uninterrupted"))
    results = Results(tmp_path / "stopped")
    train_until(3, streamed(), results, commit_every=0.0)
    assert files(train(streamed(), results)) == files(uninterrupted)
    in_memory = train(States(dataset, "face_direction", 2), Results(tmp_path / "memory"))
    errors = [record.manifest.summary["test_mse"] for record in (uninterrupted, in_memory)]
    assert errors[0] == pytest.approx(errors[1], rel=0.2)


def test_errors_are_not_committed_twice_after_interruption(trained, tmp_path):
    uninterrupted = train(trained.states, Results(tmp_path / "uninterrupted"))
    results = Results(tmp_path / "stopped")
    train_until(5, trained.states, results)
    (begun,) = results.scan("encoder")[0]
    begun.append({"encoder_errors": uninterrupted.read("encoder_errors")})
    done = train(trained.states, results)
    assert len(rows(done, "encoder_errors")) == 1
    assert files(done) == files(uninterrupted)


def without_random_state(content):
    """A checkpoint without the state of the generator on the CPU, as of an old one of a GPU."""
    kept = safetensors.numpy.load(content)
    return safetensors.numpy.save({"random.cuda": kept.pop("random.cpu"), **kept})


@pytest.mark.parametrize("change", [lambda content: b"no tensors", without_random_state])
def test_invalid_checkpoint_is_refused(trained, results, change):
    train_until(2, trained.states, results)
    (begun,) = results.scan("encoder")[0]
    begun.append({}, {CHECKPOINT: change(begun.read_file(CHECKPOINT))})
    with pytest.raises(WorkError, match=r"checkpoint can't be used .*delete the directory"):
        train(trained.states, results)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("kind", LEARNED)
def test_training_on_cuda_resumes_to_same_weights(trained, tmp_path, kind):
    options, cuda = LEARNED[kind], torch.device("cuda")

    def states():
        return States(trained.dataset, "face_direction", 2)

    more = {"options": options, "device": cuda}
    uninterrupted = train(states(), Results(tmp_path / "uninterrupted"), kind, **more)
    results = Results(tmp_path / "stopped")
    train_until(3, states(), results, kind, commit_every=0.0, **more)
    assert files(train(states(), results, kind, **more)) == files(uninterrupted)
    on_cpu = train(states(), Results(tmp_path / "cpu"), kind, options=options)
    errors = [rows(record)["test_mse"] for record in (uninterrupted, on_cpu)]
    np.testing.assert_allclose(*errors, rtol=1e-3)
    encoder = load_encoder(results, uninterrupted.id).encoder
    batch = torch.rand(5, 16, device=cuda, dtype=torch.float64)
    found = encoder.encode(batch)
    assert (found.device.type, found.dtype) == ("cuda", torch.float64)
    expected = encoder.encode(batch.cpu().numpy())
    np.testing.assert_allclose(found.cpu().numpy(), expected, atol=1e-5)


def test_each_epoch_and_feature_has_row(trained):
    epochs, features = rows(trained.record), rows(trained.record, "encoder_features")
    assert epochs["epoch"].tolist() == [1, 2, 3, 4]
    assert features["index"].tolist() == list(range(16))
    assert features["feature"].tolist() == find_task("face_direction").labels
    errors = rows(trained.record, "encoder_errors")
    for table in (epochs, features, errors):
        assert set(table["encoder"]) == {trained.record.id}
        assert table.notna().all(axis=None)
    (total,) = errors.to_dict("records")
    for name in schema.FILES["encoder_features"].names[3:]:
        assert features[name].mean() == pytest.approx(total[name])
    # One of five episodes is held out; its error is reported after each epoch.
    assert total["test_mse"] == pytest.approx(epochs["test_mse"].iloc[-1], rel=1e-5)
    assert trained.record.manifest.summary["test_mse"] == total["test_mse"]
    assert trained.record.manifest.provenance["device"] == "cpu"


def test_loaded_encoder_equals_trained_network_and_is_described(trained):
    encoder, description = load_encoder(Results(trained.results.path), trained.record.id)
    assert encoder.latent_size == description["latents"] == 3
    observations = observations_of(trained.dataset).reshape(-1, 16)
    weights = safetensors.numpy.load(trained.record.read_file(WEIGHTS))
    scaled = trained.states.scaled(observations)
    hidden = np.tanh(scaled @ weights["encoder.weight"].T + weights["encoder.bias"])
    np.testing.assert_allclose(encoder.encode(observations), hidden, atol=1e-5)
    assert (description["kind"], description["task"]) == ("dae", "face_direction")
    assert description["options"] == DenoisingAutoencoder(**CHEAP | {"epochs": 4}).model_dump()
    assert description["features"] == find_task("face_direction").labels
    np.testing.assert_array_equal(np.float32(description["minimum"]), observations.min(axis=0))
    np.testing.assert_array_equal(np.float32(description["maximum"]), observations.max(axis=0))


def test_files_depend_only_on_settings_and_seed(trained, results):
    torch.manual_seed(6)
    torch.set_num_threads(2)
    again = train_encoder(trained.settings, trained.states, results)
    assert torch.get_num_threads() == 2
    torch.set_num_threads(1)
    assert files(again) == files(trained.record)
    assert again.id == trained.record.id
    other = train(States(trained.dataset, "face_direction", 3), results)
    assert other.read_file(WEIGHTS) != again.read_file(WEIGHTS)


def test_unfinished_encoder_without_checkpoint_restarts(trained, results):
    begun = results.create("encoder", trained.settings.id, trained.settings.model_dump())
    old = trained.record.read("encoder_epochs").slice(0, 2)
    begun.append({"encoder_epochs": old})
    again = train_encoder(trained.settings, trained.states, results)
    assert rows(again)["epoch"].tolist() == [1, 2, 3, 4]
    assert files(again) == files(trained.record)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_invalid_dataset_creates_no_encoder(results, number):
    state = random_states(2)
    state.velocity[1, 400, 3] = number
    with pytest.raises(WorkError, match=r"random/a holds .*NaN or infinite"):
        train(States(make_dataset(results, state=state), "face_direction", 0), results)
    assert results.scan("encoder") == ([], [])


def test_diverged_training_is_reported_and_not_saved(trained, results):
    options = {"hidden": 8, "learning_rate": 1e6}
    with pytest.raises(WorkError, match=r"diverged: the loss of epoch \d is .*--learning-rate"):
        train(trained.states, results, "vae", options=options)
    (record,) = results.scan("encoder")[0]
    assert record.status == "unfinished"


@pytest.mark.parametrize(
    ("components", "message"),
    [
        (np.eye(16)[:4], r"encode returns the shape \(1, 4\), not \(1, 3\)"),
        (np.full((3, 16), np.nan), "weights that are not finite"),
    ],
)
def test_encoder_with_unusable_weights_is_not_saved(
    trained, results, components, message, monkeypatch
):
    fitted = {"components": components, "mean": np.zeros(16)}
    monkeypatch.setattr(PrincipalComponents, "fit", lambda *_: fitted)
    with pytest.raises(WorkError, match=f"can't be used: {message}"):
        train(trained.states, results, "pca")


def test_weights_are_trained_in_float32_and_unused_ones_stay(trained):
    class Doubles(Autoencoder):
        gradient = Learned.gradient

        def initial(self, *about):
            weights = {name: value.double() for name, value in super().initial(*about).items()}
            return weights | {"unused": torch.ones(2)}

    learner = EncoderLearner(Doubles(batch=500), trained.states, 3)
    learner.epoch()
    assert {value.dtype for value in learner.weights.values()} == {torch.float32}
    assert (learner.weights["encoder.bias"] != 0).any()
    assert learner.weights["unused"].tolist() == [1, 1]


def test_encoder_in_use_by_other_process_is_refused(trained, results):
    held = results.folder("encoder", trained.settings.id)
    with held.lock(), pytest.raises(WorkError, match="Another process is writing the encoder"):
        train_encoder(trained.settings, trained.states, results)


def test_held_out_episodes_are_not_used_in_training(results):
    (held_out,) = split_episodes(5, 2).held_out
    records = []
    for share in (0.5, 0.1):  # slower than the others, which determine the scaling
        state = random_states(5)
        state.velocity[held_out] *= share
        dataset = make_dataset(results, f"random/{share}", state)
        path = Results(results.path / str(share))
        records.append(train(States(dataset, "face_direction", 2), path))
    first, other = records
    assert first.read_file(WEIGHTS) == other.read_file(WEIGHTS)
    assert first.manifest.summary["test_mse"] != other.manifest.summary["test_mse"]
