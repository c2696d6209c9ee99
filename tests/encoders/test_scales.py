"""Tests of scales of inputs and latents, kinds of fixed size, and encoders with a seed each."""

import numpy as np
import pytest
import torch

from jbench.encoders import find_draws, find_encoder, load_encoder
from jbench.encoders.kinds.autoencoders import DenoisingAutoencoder
from jbench.encoders.kinds.linear import Raw, Scaled
from jbench.encoders.kinds.planar import PlanarReduction
from jbench.encoders.pairs import StatePairs
from jbench.encoders.saved import WEIGHTS
from jbench.encoders.scaling import rescaling
from jbench.encoders.states import States, split_episodes
from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.store import Results
from jbench.tasks.jitterbug.features import denormalize
from tests.encoders.encoder_data import (
    PLANAR_SIZES,
    fitted_encoder,
    observations_of,
    read_states,
    train,
)

TASK = "face_direction"
WHITENED = {"rescale": "whitened"}


def trained_with(data, results, kind="dae", latents=3, seed=2, **options):
    states = States(data.dataset, TASK, seed, scale=options.get("scale", "dataset"))
    return train(states, results, kind, latents, options)


def latents_of(results, record, data):
    """Returns the latents (rows, latents) of the training episodes."""
    encoder = load_encoder(results, record.id).encoder
    learned = observations_of(data.dataset)[split_episodes(data.dataset.episodes, 2)[0]]
    return encoder.encode(learned.reshape(-1, 16)).astype(np.float64)


@pytest.mark.parametrize(
    ("scale", "expected"),
    [("observation", lambda x: x), ("sd", lambda x: (x - x.mean(0)) / x.std(0))],
)
def test_features_have_requested_scale(trained, scale, expected):
    states = read_states(trained.dataset, scale=scale)
    seen = observations_of(trained.dataset).reshape(-1, 16).astype(np.float64)
    varies = np.ptp(seen, axis=0) > 1e-3
    scaled = states.scaled(seen.astype(np.float32))
    np.testing.assert_allclose(scaled[:, varies], expected(seen[:, varies]), atol=2e-4)


@pytest.mark.parametrize("kind", ["dae", "pca", "forward", "vae"])
def test_whitened_latents_have_no_mean_and_deviations_of_one_third(trained, results, kind):
    record = trained_with(trained, results, kind, **WHITENED)
    latents = latents_of(results, record, trained)
    np.testing.assert_allclose(latents.mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(np.cov(latents.T, bias=True), np.eye(3) / 9, atol=1e-4)


def test_rescaled_latents_have_extremes_of_one(trained, results):
    record = trained_with(trained, results, rescale="extremes")
    latents = latents_of(results, record, trained)
    np.testing.assert_allclose(latents.min(0), -1, atol=1e-5)
    np.testing.assert_allclose(latents.max(0), 1, atol=1e-5)


def test_standardized_latents_have_mean_zero_and_deviations_of_one(trained, results):
    """Each by itself: correlations of latents stay, unlike those of whitened ones."""
    plain = latents_of(results, trained_with(trained, results), trained)
    record = trained_with(trained, results, rescale="standardized")
    assert record.path.parent.name == "dae3-standardized"
    latents = latents_of(results, record, trained)
    np.testing.assert_allclose(latents, (plain - plain.mean(0)) / plain.std(0), atol=1e-3)
    np.testing.assert_allclose(np.corrcoef(latents.T), np.corrcoef(plain.T), atol=1e-4)


def test_constant_latents_stay_zero_when_standardized():
    latents = np.array([[1, 5], [3, 5]], np.float32)
    weights = rescaling("standardized", [latents])
    scaled = (latents - weights["rescale.center"]) @ weights["rescale.matrix"].T
    np.testing.assert_allclose(scaled, [[-1, 0], [1, 0]])
    back = scaled @ weights["rescale.inverse"].T + weights["rescale.center"]
    np.testing.assert_allclose(back, latents)


def test_rescaling_changes_neither_training_nor_reconstruction(trained, results, tmp_path):
    """The network is trained, or taken from the encoder that is not rescaled."""
    alone = trained_with(trained, Results(tmp_path / "alone"), rescale="whitened")
    plain, again = (trained_with(trained, results, **more) for more in ({}, WHITENED))
    assert again.read_file(WEIGHTS) == alone.read_file(WEIGHTS)
    losses, errors = (
        [record.read(table)[column].to_pylist() for record in (plain, alone, again)]
        for table, column in (("encoder_epochs", "train_loss"), ("encoder_errors", "test_mse"))
    )
    assert losses[0] == losses[1] == losses[2]
    np.testing.assert_allclose(errors, errors[:1] * 3, rtol=1e-4)


def test_direction_without_variance_becomes_zero(trained, results):
    """In this dataset, at most 16 directions vary; a copy of a latent adds none."""
    record = trained_with(trained, results, "pca", 16, rescale="whitened")
    latents = latents_of(results, record, trained)
    variances = latents.var(0)
    assert np.all((np.abs(variances - 1 / 9) < 1e-2) | (variances < 1e-6))


def test_scales_are_part_of_name_and_defaults_are_not(trained, results):
    plain = trained_with(trained, results)
    other = trained_with(trained, results, scale="observation", rescale="whitened")
    assert plain.id.split("/")[1] == "dae3"
    assert other.id.split("/")[1] == "dae3-observation-whitened"
    assert find_encoder(results, "dae3", TASK) == plain.id
    assert find_encoder(results, "dae:3-observation-whitened", TASK) == other.id
    with pytest.raises(RequestError, match=r"No dae3-sd for .*--kind dae .*--set scale=sd"):
        find_encoder(results, "dae3-sd", TASK)


def test_noise_of_a_batch_is_one_vector(trained):
    rows = torch.zeros(7, 4)
    kind = DenoisingAutoencoder(batch=3, noise=0.5, noise_per="batch")
    noisy = kind.prepare(StatePairs(rows, rows), 2, torch.Generator().manual_seed(0)).now
    assert [len({tuple(row) for row in part.tolist()}) for part in noisy.split(3)] == [1, 1, 1]
    assert len({tuple(row) for row in noisy.tolist()}) == 3


def test_each_agent_can_have_encoder_of_its_seed(trained, results):
    records = {seed: trained_with(trained, results, seed=seed) for seed in (2, 5)}
    draws, ids = find_draws(results, "dae3", TASK, [5, 2])
    assert ids == {5: records[5].id, 2: records[2].id}
    assert len(draws) == 8
    with pytest.raises(RequestError, match=r"the seed 4 .*jbench train-dae .*--seed 4"):
        find_draws(results, "dae3", TASK, [2, 4])


@pytest.mark.parametrize("memory", [1 << 30, 300_000])
@pytest.mark.parametrize("task", TASKS)
def test_planar_latents_range_from_minus_one_to_one(trained, task, memory):
    states = read_states(trained.dataset, task, memory=memory)
    assert states.in_memory == (memory > 300_000)
    latents = fitted_encoder(PlanarReduction(), states).encode(
        observations_of(trained.dataset, task)
    )
    assert latents.shape[-1] == PLANAR_SIZES[task]
    np.testing.assert_allclose(latents.min((0, 1)), -1, atol=1e-4)
    np.testing.assert_allclose(latents.max((0, 1)), 1, atol=1e-4)


@pytest.mark.parametrize("task", TASKS)
def test_scaled_is_scaled_observation_and_raw_is_in_si_units(trained, task):
    states, seen = read_states(trained.dataset, task), observations_of(trained.dataset, task)
    scaled, raw = (fitted_encoder(kind, states).encode(seen) for kind in (Scaled(), Raw()))
    np.testing.assert_allclose(scaled, states.scaled(seen), atol=1e-6)
    np.testing.assert_allclose(raw, denormalize(task, seen), rtol=1e-3, atol=1e-3)


def test_kind_of_fixed_size_is_found_by_name(trained, results):
    for kind, latents in (("scaled", 16), ("planar", 12)):
        record = train(trained.states, results, kind, latents)
        for name in (kind, f"{kind}:{latents}"):
            assert find_encoder(results, name, TASK) == record.id


def test_dae_with_yaw_rate_appends_scaled_yaw_rate(trained, results):
    record, plain = (train(trained.states, results, *kind) for kind in (("dae-yaw", 4), ("dae", 3)))
    observations = observations_of(trained.dataset)
    latents, inner = (
        load_encoder(results, r.id).encoder.encode(observations) for r in (record, plain)
    )
    np.testing.assert_array_equal(latents[..., :3], inner)
    np.testing.assert_allclose(
        latents[..., 3], trained.states.scaled(observations)[..., 12], atol=1e-6
    )
