"""Tests of the reported errors of encoders, against numpy on the same states."""

import numpy as np
import pytest
import safetensors.numpy

from jbench.encoders import evaluation
from jbench.encoders.evaluation import heuristic_episodes
from jbench.encoders.registry import make_kind
from jbench.encoders.saved import WEIGHTS
from jbench.encoders.states import split_episodes
from jbench.tasks import features
from tests.encoders.encoder_data import observations_of, rows, train


def weights_of(record):
    return safetensors.numpy.load(record.read_file(WEIGHTS))


def reconstructions(record, trained, data):
    """The reconstructions (states, size) of a saved encoder, and their targets."""
    kind = make_kind(record.settings["kind"], record.settings["options"])
    episodes = {
        "test": observations_of(trained.dataset)[split_episodes(5, 2)[1]],
        "heuristic": heuristic_episodes("face_direction", None)[0],
    }[data]
    scaled = trained.states.scaled(episodes)
    ahead = kind.steps_ahead if kind.decodes_later else 0
    now, later = scaled[:, : 1001 - ahead], scaled[:, ahead:]
    weights = weights_of(record)
    rebuilt = kind.decode(weights, kind.encode(weights, now))
    return rebuilt.reshape(-1, 16).astype(np.float64), later.reshape(-1, 16).astype(np.float64)


@pytest.mark.parametrize("data", ["test", "heuristic"])
@pytest.mark.parametrize("kind", ["dae", "ddae", "vae", "lld-vae", "pca", "random"])
def test_errors_equal_those_of_saved_encoder(trained, results, kind, data):
    record = train(trained.states, results, kind)
    rebuilt, expected = reconstructions(record, trained, data)
    mse, variance = np.mean((rebuilt - expected) ** 2, axis=0), expected.var(axis=0)
    found = rows(record, "encoder_features")
    np.testing.assert_allclose(found[f"{data}_mse"], mse, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(found[f"{data}_variance"], variance, rtol=1e-4, atol=1e-9)
    (total,) = rows(record, "encoder_errors").to_dict("records")
    assert total[f"{data}_explained"] == pytest.approx(1 - mse.sum() / variance.sum(), rel=1e-4)


@pytest.mark.parametrize("latents", [1, 5, 16])
def test_baseline_errors_equal_those_of_pca_and_random(trained, results, latents):
    beside = rows(train(trained.states, results, "ae", latents), "encoder_features")
    for kind in ("pca", "random"):
        own = rows(train(trained.states, results, kind, latents), "encoder_features")
        for reported, expected in (
            (f"{kind}_mse", "test_mse"),
            (f"{kind}_heuristic_mse", "heuristic_mse"),
        ):
            np.testing.assert_allclose(beside[reported], own[expected], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("task", "episodes"),
    [("face_direction", 2), pytest.param("move_to_pose", 10, marks=pytest.mark.slow)],
)
def test_heuristic_episodes_are_reproducible(task, episodes, monkeypatch):
    if episodes != evaluation._EPISODES:
        monkeypatch.setattr(evaluation, "_EPISODES", episodes)
        heuristic_episodes.cache_clear()
    observed, actions, rewards = heuristic_episodes(task, None)
    size = features.observation_size(task)
    assert (observed.shape, actions.shape) == ((episodes, 1001, size), (episodes, 1000))
    assert ((rewards >= 0) & (rewards <= 1)).all()
    assert np.isfinite(observed).all()
    # Episodes begin at the origin at rest, in different poses.
    physical = features.denormalize(task, observed[:, 0].astype(np.float64))
    np.testing.assert_allclose(physical[:, :3], [[0, 0, 0.035]] * episodes, atol=1e-6)
    assert len(np.unique(physical[:, 3])) == episodes
    assert heuristic_episodes(task, None)[0] is observed
