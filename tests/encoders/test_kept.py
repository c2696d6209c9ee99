"""Tests of the column `kept`: the share of each feature that an encoder keeps."""

import numpy as np
import pytest
import torch

from jbench.encoders.kind import Learned
from jbench.encoders.registry import latent_sizes, make_kind
from jbench.encoders.states import States
from jbench.representation_names import ENCODER_KINDS
from jbench.store.kept_features import kept, kept_by
from jbench.store.query import query_results
from jbench.store.shipped import shipped_results
from tests.encoders.encoder_data import read_states, train

TASK = "face_direction"


def column(results, encoder="%"):
    sql = f"SELECT kept FROM encoder_features WHERE encoder LIKE '{encoder}' ORDER BY index"
    frame, problems, _ = query_results(results, sql)
    assert problems == []
    return frame["kept"].to_numpy(float)


def test_shares_are_squared_lengths_of_projections():
    # The span of (1, 1, 0) and (0, 0, 2): the first two features share a direction.
    directions = np.array([[1, 1, 0], [0, 0, 2], [2, 2, 2]])
    np.testing.assert_allclose(kept_by(directions), [0.5, 0.5, 1])


def test_shares_equal_those_of_a_qr_decomposition():
    directions = np.random.default_rng(0).normal(size=(12, 16))
    basis, _ = np.linalg.qr(directions.T)
    np.testing.assert_allclose(kept_by(directions), np.square(basis).sum(1))
    assert kept_by(directions).sum() == pytest.approx(12)


@pytest.mark.parametrize(
    ("name", "share"), [("dae12", 0.067), ("dae12-observation", 1.0), ("planar12", np.nan)]
)
def test_shipped_encoders_keep_this_much_of_the_yaw_rate(name, share):
    yaw_rate = column(shipped_results(), f"{TASK}/{name}/s00-%")[12]
    assert yaw_rate == pytest.approx(share, abs=1e-3, nan_ok=True)


@pytest.mark.parametrize("kind", ENCODER_KINDS)
def test_kinds_of_one_layer_are_those_whose_gradients_span_no_more_directions(kind, trained):
    """The oracle are the gradients of the latents at many states, by automatic differentiation."""
    sizes = latent_sizes(kind, TASK)
    latents = 3 if 3 in sizes else sizes[0]
    states = read_states(trained.dataset)
    made = make_kind(kind, {})
    if isinstance(made, Learned):
        weights = made.initial(states.size, latents, torch.Generator().manual_seed(0))
    else:
        fitted = made.fit(states, latents).items()
        weights = {name: torch.tensor(value, dtype=torch.float32) for name, value in fitted}

    rows = states.sample.states[0, ::100]
    gradients = torch.autograd.functional.jacobian(lambda x: made.encode(weights, x).sum(0), rows)
    spanned = kept_by(gradients.reshape(-1, states.size).numpy())
    arrays = {name: value.numpy() for name, value in weights.items()}
    shares = kept(kind, arrays, states.labels)
    if shares is None:
        assert spanned.sum() > latents + 0.5 or latents == states.size
    else:
        np.testing.assert_allclose(shares, spanned, atol=1e-3)


def test_share_of_chosen_features_only(trained, results):
    train(States(trained.dataset, TASK, 2), results, "pca", 2, {"features": "velocity"})
    shares = column(results)
    assert shares.shape == (6,)
    assert shares.sum() == pytest.approx(2, abs=1e-4)


def test_damaged_weights_are_a_problem_of_the_encoder(trained, results):
    record = train(States(trained.dataset, TASK, 2), results, "pca", 2)
    (record.path / "encoder.safetensors").write_bytes(b"no")
    frame, (problem,), _ = query_results(results, "SELECT kept FROM encoder_features")
    assert len(frame) == 0
    assert "encoder.safetensors is damaged" in problem


def test_share_is_null_without_weights(trained, results):
    """As of an encoder of an old version, or one whose weights its folder may lack."""
    record = results.create("encoder", trained.record.id, trained.record.settings)
    record.append({"encoder_features": trained.record.read("encoder_features")})
    record.finish({"test_mse": 0.1})
    shares = column(results)
    assert shares.shape == (16,)
    assert np.isnan(shares).all()
