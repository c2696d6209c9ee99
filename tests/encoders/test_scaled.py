"""Tests of `scaled` and `planar`, the encoders whose size the task determines."""

import numpy as np
import pytest

from jbench.encoders import find_encoder, load_encoder
from jbench.encoders.kinds.linear import Raw, Scaled
from jbench.encoders.kinds.planar import PlanarReduction
from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.tasks.features import denormalize, observation_size
from tests.encoders.encoder_data import (
    PLANAR_SIZES,
    fitted_encoder,
    observations_of,
    read_states,
    rows,
    train,
)


@pytest.mark.parametrize("task", TASKS)
def test_scaled_maps_extremes_of_each_feature_to_one(trained, task):
    encoder = fitted_encoder(Scaled(), read_states(trained.dataset, task))
    assert encoder.latent_size == observation_size(task)
    seen = observations_of(trained.dataset, task).astype(np.float64)
    low, high = seen.min((0, 1)), seen.max((0, 1))
    expected = 2 * (seen - low) / np.where(high > low, high - low, np.inf) - (high > low)
    np.testing.assert_allclose(encoder.encode(seen.astype(np.float32)), expected, atol=1e-5)
    latents = encoder.encode(seen)
    np.testing.assert_array_equal(Scaled().decode({}, latents), latents)


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
def test_raw_is_observation_in_si_units(trained, task):
    encoder = fitted_encoder(Raw(), read_states(trained.dataset, task))
    seen = observations_of(trained.dataset, task)
    np.testing.assert_allclose(encoder.encode(seen), denormalize(task, seen), rtol=1e-3, atol=1e-3)


def test_kind_of_fixed_size_is_found_by_name(trained, results):
    for kind, latents in (("scaled", 16), ("planar", 12)):
        record = train(trained.states, results, kind, latents)
        assert find_encoder(results, kind, "face_direction") == record.id
        assert find_encoder(results, f"{kind}:{latents}", "face_direction") == record.id
        if kind == "scaled":
            assert rows(record, "encoder_features")["test_mse"].tolist() == [0] * 16


@pytest.mark.parametrize(
    ("expected", "message"),
    [
        ("planar:11", "planar of face_direction has 12 latents; choose planar."),
        ("planar", "type jbench train-encoder --kind planar --task face_direction "),
        ("planar:12", "type jbench train-encoder --kind planar --task face_direction "),
    ],
)
def test_invalid_size_is_refused_with_option_to_type(results, expected, message):
    with pytest.raises(RequestError, match=message):
        find_encoder(results, expected, "face_direction")


def test_dae_with_yaw_rate_appends_scaled_yaw_rate(trained, results):
    record, plain = (train(trained.states, results, *kind) for kind in (("dae-yaw", 4), ("dae", 3)))
    observations = observations_of(trained.dataset)
    latents, inner = (load_encoder(results, r.id)[0].encode(observations) for r in (record, plain))
    np.testing.assert_array_equal(latents[..., :3], inner)
    np.testing.assert_allclose(
        latents[..., 3], trained.states.scaled(observations)[..., 12], atol=1e-6
    )
