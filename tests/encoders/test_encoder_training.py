"""From a dataset to a kept encoder: what is split, what is kept, what is refused."""

import hashlib
import json
import math

import numpy as np
import pytest
import torch
from encoder_data import made_up_states, make_dataset
from pydantic import ValidationError

from jbench.encoders import dae, load_encoder
from jbench.encoders.encoder import DESCRIPTION, WEIGHTS
from jbench.encoders.training import EncoderSettings, split_episodes, train_encoder
from jbench.errors import RequestError, WorkError
from jbench.store import Record, Results, query, schema
from jbench.tasks.features import feature_labels


def train_again(trained, results, **changes):
    settings = trained.settings.model_copy(update=changes)
    return train_encoder(settings, trained.dataset, results)


def in_memory(trained):
    """The same training without a store: the network, and the held-out observations."""
    observations = trained.dataset.observations("face_direction")
    learned, held_out = split_episodes(5, 2)
    learn, test = (observations[chosen].reshape(-1, 16) for chosen in (learned, held_out))
    wanted = {"latents": 3, "noise": 0.1, "epochs": 4, "batch": 500, "learning_rate": 1e-3}
    return dae.train(learn, test, seed=2, **wanted), test


@pytest.mark.parametrize("episodes", [2, 5, 10, 13, 5000])
def test_split_is_of_whole_episodes_eighty_to_twenty(episodes):
    learned, held_out = split_episodes(episodes, 0)
    assert sorted([*learned, *held_out]) == list(range(episodes))
    assert len(held_out) == max(1, round(episodes / 5))


def test_split_depends_on_the_seed_alone():
    splits = [split_episodes(100, seed)[1].tolist() for seed in (0, 0, 1)]
    assert splits[0] == splits[1] != splits[2]
    assert splits[0] != list(range(20))


def test_held_out_episodes_are_not_learned_from(results):
    settings = EncoderSettings(dataset="random/a", latents=2, epochs=1, noise=0, batch=500)
    (held_out,) = split_episodes(5, settings.seed)[1]
    records = []
    for share in (0.5, 0.1):  # slower than the others, so that the scaling is of the others
        state = made_up_states(5)
        state.velocity[held_out] *= share
        dataset = make_dataset(results, f"random/{share}", state)
        records.append(train_encoder(settings, dataset, Results(results.path / str(share))))
    first, other = records
    assert first.read_file(WEIGHTS) == other.read_file(WEIGHTS)
    assert first.manifest.summary["test_mse"] != other.manifest.summary["test_mse"]


def test_rows_are_kept_for_each_epoch_and_for_each_feature(trained):
    epochs = trained.record.read("encoder_epochs", schema.ENCODER_EPOCHS).to_pandas()
    features = trained.record.read("encoder_features", schema.ENCODER_FEATURES).to_pandas()
    assert epochs["epoch"].tolist() == [1, 2, 3, 4]
    assert features["index"].tolist() == list(range(16))
    assert features["feature"].tolist() == feature_labels("face_direction")
    for rows in (epochs, features):
        assert set(rows["encoder"]) == {trained.record.id}
        assert rows.notna().all(axis=None)
    last = epochs["test_mse"].iloc[-1]
    assert features["test_mse"].mean() == pytest.approx(last, abs=1e-6)
    assert trained.record.manifest.summary["test_mse"] == last


def test_errors_that_are_kept_are_the_networks(trained):
    training, test = in_memory(trained)
    gain, offset = training.scaling.gain_and_offset()
    scaled = test * gain + offset
    rebuilt = training.model(torch.from_numpy(scaled)).detach().numpy()
    features = trained.record.read("encoder_features", schema.ENCODER_FEATURES).to_pandas()
    wanted = np.mean((rebuilt - scaled) ** 2, axis=0)
    np.testing.assert_allclose(features["test_mse"], wanted, rtol=1e-4)
    np.testing.assert_allclose(features["test_variance"], scaled.var(axis=0), rtol=1e-4)


def test_encoder_that_is_loaded_gives_the_latents_of_the_trained_network(trained):
    training, test = in_memory(trained)
    layer = training.model.encoder
    now = dae.TanhEncoder(layer.weight.detach(), layer.bias.detach(), training.scaling)
    loaded, description = load_encoder(Results(trained.results.path), trained.record.id)
    assert loaded.latent_size == description["latents"] == 3
    np.testing.assert_array_equal(loaded.encode(test), now.encode(test))
    gain, offset = training.scaling.gain_and_offset()
    hidden = torch.tanh(layer(torch.from_numpy(test * gain + offset)))
    np.testing.assert_allclose(loaded.encode(test), hidden.detach().numpy(), atol=1e-5)


def test_description_says_what_the_encoder_is_of(trained):
    _, description = load_encoder(trained.results, trained.record.id)
    observations = trained.dataset.observations("face_direction").reshape(-1, 16)
    assert (description["kind"], description["task"]) == ("dae", "face_direction")
    assert description["features"] == feature_labels("face_direction")
    np.testing.assert_array_equal(np.float32(description["minimum"]), observations.min(axis=0))
    np.testing.assert_array_equal(np.float32(description["maximum"]), observations.max(axis=0))


def test_same_settings_give_the_same_files_elsewhere(trained, results):
    again = train_again(trained, results)
    other = train_again(trained, results, seed=3)
    for name in (WEIGHTS, DESCRIPTION):
        assert again.read_file(name) == trained.record.read_file(name)
    assert other.read_file(WEIGHTS) != again.read_file(WEIGHTS)
    assert other.id != again.id == trained.record.id


def test_finished_encoder_is_not_trained_again(trained):
    def state():
        found = {path.name: path.stat() for path in trained.record.path.iterdir()}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found.items()}

    before, seen = state(), []
    again = train_encoder(trained.settings, trained.dataset, trained.results, seen.append)
    assert (again.id, seen) == (trained.record.id, [])
    assert state() == before


def test_unfinished_encoder_starts_over(trained, results):
    begun = results.create("encoder", trained.settings.id, trained.settings.model_dump())
    old = trained.record.read("encoder_epochs", schema.ENCODER_EPOCHS).slice(0, 2)
    begun.append({"encoder_epochs": old})
    again = train_again(trained, results)
    epochs = again.read("encoder_epochs", schema.ENCODER_EPOCHS)["epoch"].to_pylist()
    assert epochs == [1, 2, 3, 4]
    assert again.read_file(WEIGHTS) == trained.record.read_file(WEIGHTS)


def test_progress_counts_the_epochs(trained, results):
    seen = []
    train_encoder(trained.settings, trained.dataset, results, seen.append)
    assert seen == [1, 2, 3, 4]


def test_encoder_is_a_row_of_the_database(trained):
    (row,) = query.load(trained.results).tables["encoders"].to_pylist()
    wanted = {"representation": "dae3", "task": "face_direction", "latents": 3, "seed": 2}
    assert wanted.items() <= row.items()
    assert row["test_mse"] == trained.record.manifest.summary["test_mse"]


def test_settings_are_the_papers_by_default():
    settings = EncoderSettings(dataset="random/a")
    assert (settings.latents, settings.noise, settings.learning_rate) == (12, 0.1, 1e-3)
    assert (settings.epochs, settings.batch, settings.task) == (200, 8192, "face_direction")
    text = json.dumps(settings.model_dump(), sort_keys=True, separators=(",", ":"))
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    assert settings.id == f"face_direction/dae12/s00-{digest}"


@pytest.mark.parametrize(
    ("task", "latents", "said"),
    [
        ("face_direction", 17, "face_direction has 16 features: type --latent 1 to 16"),
        ("move_from_origin", 16, "type --latent 1 to 15"),
        ("move_to_pose", 100, "type --latent 1 to 19"),
        ("face_direction", 0, "greater than or equal to 1"),
        ("face_direction", -1, "greater than or equal to 1"),
    ],
)
def test_latents_beyond_the_features_are_refused(task, latents, said):
    with pytest.raises(ValidationError, match=said):
        EncoderSettings(dataset="random/a", task=task, latents=latents)


@pytest.mark.parametrize(
    "change",
    [
        *({"noise": -0.1}, {"noise": math.nan}, {"noise": math.inf}, {"epochs": 0}, {"batch": 0}),
        *({"learning_rate": 0}, {"learning_rate": math.inf}, {"seed": -1}, {"rate": 1}),
    ],
)
def test_settings_that_train_nothing_are_refused(change):
    with pytest.raises(ValidationError):
        EncoderSettings(dataset="random/a", **change)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_dataset_with_what_is_no_number_is_refused_and_nothing_is_kept(results, number):
    state = made_up_states(2)
    state.velocity[1, 400, 3] = number
    dataset = make_dataset(results, state=state)
    settings = EncoderSettings(dataset=dataset.id, epochs=1)
    with pytest.raises(WorkError, match="random/a holds NaN or infinite values; collect it anew"):
        train_encoder(settings, dataset, results)
    assert results.find("encoder", settings.id) is None


def test_dataset_of_one_episode_is_refused(results):
    dataset = make_dataset(results, episodes=1)
    with pytest.raises(RequestError, match="episode"):
        train_encoder(EncoderSettings(dataset=dataset.id, epochs=1), dataset, results)


def test_two_processes_do_not_train_the_same_encoder(trained, results):
    held = Record(results, "encoder", trained.settings.id)
    with held.lock(), pytest.raises(WorkError, match="Another process is writing the encoder"):
        train_again(trained, results)
