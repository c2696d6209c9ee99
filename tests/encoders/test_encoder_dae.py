"""The autoencoder: its scaling and its encoder by hand, its training by what it must learn."""

import numpy as np
import pytest
import safetensors.torch
import torch

from jbench.encoders.dae import DenoisingAutoencoder, Scaling, TanhEncoder, train

OBSERVATIONS = np.array([[0, 5, -1], [4, 5, 1], [1, 5, 3]], np.float32)

# Two latents of three features, of which the second never changes.
WEIGHT = np.array([[0.5, 9.0, -1.0], [0.25, 9.0, 0.75]], np.float32)
BIAS = np.array([0.1, -0.2], np.float32)
LATENTS = np.tanh(
    [
        # OBSERVATIONS scaled by hand: (-1, 0, -1), (1, 0, 0), (-0.5, 0, 1).
        [-0.5 + 1 + 0.1, -0.25 - 0.75 - 0.2],
        [0.5 + 0.1, 0.25 - 0.2],
        [-0.25 - 1 + 0.1, -0.125 + 0.75 - 0.2],
    ]
)
EASY = {"noise": 0.0, "epochs": 20, "batch": 64, "learning_rate": 1e-2, "seed": 0}


@pytest.fixture
def encoder():
    scaling = Scaling.of(OBSERVATIONS)
    return TanhEncoder(torch.from_numpy(WEIGHT), torch.from_numpy(BIAS), scaling)


def of_rank_two():
    """1000 rows to learn from and 250 to test: two hidden numbers seen in six features."""
    random = np.random.default_rng(0)
    rows = random.uniform(-1, 1, (1250, 2)) @ random.normal(size=(2, 6))
    return rows[:1000].astype(np.float32), rows[1000:].astype(np.float32)


def trained(**changes):
    return train(*of_rank_two(), **{"latents": 2, **EASY, **changes})


def weights(training):
    return safetensors.torch.save(training.model.state_dict())


def explained(training):
    """Share of the features' variance that the reconstruction has."""
    return 1 - training.feature_errors.sum() / training.feature_variances.sum()


def test_scaling_maps_extremes_to_one_and_constants_to_zero():
    gain, offset = Scaling.of(OBSERVATIONS).gain_and_offset()
    np.testing.assert_array_equal(gain, [0.5, 0, 0.5])
    np.testing.assert_array_equal(offset, [-1, 0, 0 - 0.5])
    np.testing.assert_array_equal(
        gain * OBSERVATIONS + offset, [[-1, 0, -1], [1, 0, 0], [-0.5, 0, 1]]
    )


def test_scaling_is_of_all_leading_axes():
    stacked = Scaling.of(OBSERVATIONS.reshape(3, 1, 1, 3))
    np.testing.assert_array_equal(stacked.minimum, [0, 5, -1])
    np.testing.assert_array_equal(stacked.maximum, [4, 5, 3])


def test_encoder_is_tanh_of_the_affine_map_of_scaled_features(encoder):
    assert encoder.latent_size == 2
    found = encoder.encode(OBSERVATIONS)
    np.testing.assert_allclose(found, LATENTS, atol=1e-6)
    assert found.dtype == np.float32


@pytest.mark.parametrize("shape", [(3,), (1, 3), (4, 3), (2, 5, 3), (0, 3)])
def test_leading_axes_are_free_in_numpy_and_in_torch(encoder, shape):
    batch = np.random.default_rng(0).uniform(-2, 6, shape).astype(np.float32)
    rows = batch.reshape(-1, 3)
    scaled = rows * [0.5, 0, 0.5] + [-1, 0, -0.5]
    wanted = np.tanh(scaled @ WEIGHT.T + BIAS).reshape(*shape[:-1], 2)
    ours, theirs = encoder.encode(batch), encoder.encode(torch.from_numpy(batch))
    assert isinstance(ours, np.ndarray)
    assert isinstance(theirs, torch.Tensor)
    np.testing.assert_allclose(ours, wanted, atol=1e-6)
    np.testing.assert_allclose(theirs.numpy(), wanted, atol=1e-6)


def test_constant_feature_says_nothing_whatever_it_becomes(encoder):
    changed = OBSERVATIONS + np.array([0, 100, 0], np.float32)
    np.testing.assert_array_equal(encoder.encode(changed), encoder.encode(OBSERVATIONS))


def test_new_network_is_glorots_and_its_reconstruction_two_tanh_layers():
    network = DenoisingAutoencoder(16, 12, torch.Generator().manual_seed(0))
    limit = np.sqrt(6 / (16 + 12))
    inner, outer = (layer.weight.detach().numpy() for layer in (network.encoder, network.decoder))
    for matrix in (inner, outer):
        assert 0.95 * limit < np.abs(matrix).max() <= limit
    assert not network.encoder.bias.any()
    assert not network.decoder.bias.any()
    batch = np.random.default_rng(0).uniform(-1, 1, (5, 16)).astype(np.float32)
    wanted = np.tanh(np.tanh(batch @ inner.T) @ outer.T)
    found = network(torch.from_numpy(batch)).detach().numpy()
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_same_seed_gives_the_same_bytes_and_another_seed_others():
    assert weights(trained(noise=0.1)) == weights(trained(noise=0.1))
    assert weights(trained(noise=0.1)) != weights(trained(noise=0.1, seed=1))


def test_global_random_numbers_do_not_matter():
    found = []
    for seed in (5, 6):
        torch.manual_seed(seed)
        found.append(weights(trained(noise=0.1, epochs=2)))
    assert found[0] == found[1]


def test_two_latents_explain_data_of_rank_two_and_one_does_not():
    assert explained(trained()) > 0.9
    assert explained(trained(latents=1)) < 0.85


def test_error_falls_from_that_of_the_new_network():
    learn, _ = of_rank_two()
    training = trained(batch=len(learn))  # one step for each epoch
    gain, offset = training.scaling.gain_and_offset()
    scaled = torch.from_numpy(learn * gain + offset)
    new = DenoisingAutoencoder(6, 2, torch.Generator().manual_seed(EASY["seed"]))
    errors = [epoch["train_mse"] for epoch in training.epochs]
    assert errors[0] == pytest.approx((new(scaled) - scaled).square().mean().item(), rel=1e-5)
    assert errors == sorted(errors, reverse=True)
    assert [epoch["epoch"] for epoch in training.epochs] == list(range(1, 21))


def test_errors_on_test_rows_are_the_networks():
    _, test = of_rank_two()
    training = trained()
    gain, offset = training.scaling.gain_and_offset()
    scaled = test * gain + offset
    rebuilt = training.model(torch.from_numpy(scaled)).detach().numpy()
    np.testing.assert_allclose(
        training.feature_errors, np.mean((rebuilt - scaled) ** 2, axis=0), rtol=1e-4
    )
    np.testing.assert_allclose(training.feature_variances, scaled.var(axis=0), rtol=1e-4)
    assert training.epochs[-1]["test_mse"] == pytest.approx(training.feature_errors.mean())


def test_inputs_are_scaled_by_the_extremes_of_all_rows():
    learn, test = of_rank_two()
    test[7] = 50  # beyond every row to learn from
    scaling = train(learn, test, latents=2, **{**EASY, "epochs": 1}).scaling
    np.testing.assert_array_equal(scaling.maximum, [50] * 6)
    np.testing.assert_array_equal(scaling.minimum, np.minimum(learn.min(axis=0), test.min(axis=0)))


def test_noise_corrupts_the_input_and_not_what_is_wanted():
    clean, noisy = trained(), trained(noise=0.5)
    for epoch in clean.epochs:
        assert epoch["test_denoising_mse"] == epoch["test_mse"]
    for epoch in noisy.epochs:
        assert epoch["test_denoising_mse"] > epoch["test_mse"]
    # If the noisy features were wanted, the noise in the four directions that two latents cannot
    # give back would be left: 4 / 6 of its variance of 0.25.
    assert noisy.epochs[-1]["train_mse"] < 4 / 6 * 0.25 / 2


def test_noise_is_of_the_standard_deviation_that_is_asked_for():
    learn, _ = of_rank_two()
    training = trained(noise=0.5, batch=len(learn), epochs=1, learning_rate=1e-9)
    gain, offset = training.scaling.gain_and_offset()
    scaled = learn * gain + offset
    noise = np.random.default_rng(1).normal(0, 0.5, (100, *scaled.shape))
    with torch.no_grad():
        rebuilt = training.model(torch.from_numpy(np.float32(scaled + noise))).numpy()
    wanted = np.mean((rebuilt - scaled) ** 2)
    assert training.epochs[0]["train_mse"] == pytest.approx(wanted, rel=0.05)
    assert training.epochs[0]["test_denoising_mse"] == pytest.approx(wanted, rel=0.1)
