"""Tests of the settings of encoders: their ids, sizes and options, and numbers of epochs."""

import math

import pytest

from jbench.encoders.registry import encoder_settings, options_with_epochs
from jbench.errors import RequestError
from jbench.store import Results
from jbench.store.shipped import shipped


@pytest.mark.parametrize(
    ("kind", "options", "episodes", "epochs"),
    [
        # 4,000 episodes for training: 489 batches of 8,192 rows, so 97,800 updates.
        ("dae", {}, 5000, 200),
        ("contrastive", {}, 5000, 50),
        ("dae", {}, 20, 2000),  # 16,000 rows: 2 batches
        ("dae", {}, 100, 400),  # 80,000 rows: 10 batches
        ("dae", {"batch": 256}, 20, 200),  # 63 batches: 12,600 updates
        ("dae", {"epochs": 3}, 20, 3),
        ("pca", {}, 20, None),
    ],
)
def test_epochs_of_dataset(kind, options, episodes, epochs):
    found = options_with_epochs(kind, options, episodes, seed=0)
    assert found == options | ({"epochs": epochs} if epochs else {})


@pytest.mark.parametrize(
    ("task", "latents", "message"),
    [
        ("face_direction", 17, "A dae encoder of face_direction has 1 to 16 latents, not 17"),
        ("move_to_pose", 100, "has 1 to 19 latents, not 100"),
        ("bogus", 3, "Unknown task 'bogus'; choose move_from_origin"),
        ("face_direction", 0, "latents of the encoder can't be 0"),
        ("face_direction", -1, "greater than or equal to 1"),
    ],
)
def test_invalid_number_of_latents_is_refused(task, latents, message):
    with pytest.raises(RequestError, match=message):
        encoder_settings("dae", {}, dataset="random/a", task=task, latents=latents)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        *(("dae", {"noise": value}, "noise of dae can't be") for value in (math.nan, "x")),
        ("dae", {"epochs": 0}, "epochs of dae can't be 0"),
        ("dae", {"epochs": object}, "epochs of dae can't be \"<class 'object'>\""),
        ("dae", {"epochs": 1.5}, "epochs of dae can't be 1.5"),
        ("ae", {"batch": 0}, "batch of ae can't be 0"),
        ("vae", {"learning_rate": math.inf}, "learning_rate of vae can't be inf"),
        ("ddae", {"horizon": 0}, "horizon of ddae can't be 0"),
        ("ddae", {"horizon": 1000}, "horizon of ddae can't be 1000"),
        ("dae", {"horizon": 2}, "dae has no option horizon; it has batch, epochs,"),
        (
            "ae",
            {"noise": 0.1},
            "ae has no option noise; it has batch, epochs, features, initial_weights",
        ),
        ("pca", {"epochs": 3}, "pca has no option epochs; it has features, rescale, scale"),
    ],
)
def test_invalid_options_are_refused(kind, options, message):
    with pytest.raises(RequestError, match=message):
        encoder_settings(kind, options, dataset="random/a")


def test_ids_of_default_options_are_those_of_older_versions():
    settings = encoder_settings(
        "dae", {}, task="face_direction", dataset="random/s00-00000000", latents=12
    )
    assert settings.options == {
        "epochs": 200, "batch": 8192, "learning_rate": 1e-3, "noise": 0.1
    }  # fmt: skip
    assert settings.id == "face_direction/dae12/s00-" + settings.hash
    for record in Results(shipped()).scan("encoder")[0]:
        assert encoder_settings(**record.settings).id == record.id


def test_random_features_may_outnumber_features():
    settings = encoder_settings("random-features", {}, dataset="random/a", latents=240)
    assert settings.representation == "random-features240"
