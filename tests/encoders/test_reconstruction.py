"""Tests of the reported errors of encoders, against numpy on the same states."""

import numpy as np
import pytest
import safetensors.numpy

from jbench.encoders import reconstruction
from jbench.encoders.registry import make_kind
from jbench.encoders.saved import WEIGHTS
from jbench.encoders.states import split_episodes
from tests.encoders.encoder_data import observations_of, rows, train


def reconstructions(record, scaled):
    """The reconstructions (states, size) of a saved encoder, and their targets."""
    kind = make_kind(record.settings["kind"], record.settings["options"])
    ahead = kind.steps_ahead if kind.decodes_later else 0
    now, later = scaled[:, : 1001 - ahead], scaled[:, ahead:]
    weights = safetensors.numpy.load(record.read_file(WEIGHTS))
    rebuilt = kind.decode(weights, kind.encode(weights, now))
    return rebuilt.reshape(-1, 16).astype(np.float64), later.reshape(-1, 16).astype(np.float64)


@pytest.mark.parametrize(
    "kind",
    [
        *("dae", "lld-vae", "pca", "random"),
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("ddae", "vae")),
    ],
)
def test_errors_equal_those_of_saved_encoder(trained, results, kind):
    record = train(trained.states, results, kind)
    found = rows(record, "encoder_features")
    (total,) = rows(record, "encoder_errors").to_dict("records")
    for data, episodes in (
        ("test", observations_of(trained.dataset)[split_episodes(5, 2).held_out]),
        ("heuristic", reconstruction.heuristic_episodes("face_direction", None)),
    ):
        rebuilt, expected = reconstructions(record, trained.states.scaled(episodes))
        mse, variance = np.mean((rebuilt - expected) ** 2, axis=0), expected.var(axis=0)
        np.testing.assert_allclose(found[f"{data}_mse"], mse, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(found[f"{data}_variance"], variance, rtol=1e-4, atol=1e-9)
        explained = 1 - mse.sum() / variance.sum()
        assert total[f"{data}_explained"] == pytest.approx(explained, rel=1e-4)


@pytest.mark.parametrize(
    "latents", [5, *(pytest.param(latents, marks=pytest.mark.slow) for latents in (1, 16))]
)
def test_baseline_errors_equal_those_of_pca_and_random(trained, results, latents):
    beside = rows(train(trained.states, results, "ae", latents), "encoder_features")
    for kind in ("pca", "random"):
        own = rows(train(trained.states, results, kind, latents), "encoder_features")
        for name, expected in (("mse", "test_mse"), ("heuristic_mse", "heuristic_mse")):
            reported = beside[f"{kind}_{name}"]
            np.testing.assert_allclose(reported, own[expected], rtol=1e-3, atol=1e-9)
