"""Tests of the settings of encoders: their ids, sizes and options, and numbers of epochs."""

import math
import re

import pytest

from jbench.encoders.registry import find_kind, options_with_epochs
from jbench.encoders.representations import named_encoder
from jbench.encoders.settings import encoder_settings
from jbench.errors import RequestError
from jbench.representation_names import ENCODER_KINDS, kind_in
from jbench.store import Results
from jbench.store.shipped import shipped

SCRIPT = {"initial_weights": "normal", "noise_per": "batch", "learning_rate": 5e-4}


@pytest.mark.parametrize("kind", ENCODER_KINDS)
def test_every_option_says_what_it_means_and_then_its_source(kind):
    for name, field in find_kind(kind).model_fields.items():
        meaning, _, source = field.description.rpartition("; ")
        assert source.startswith(("paper", "authors' script", "authors' code", "ours")), name
        assert len(meaning.split()) > 2, name


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
    found = options_with_epochs(kind, options, episodes, episode_steps=1000, seed=0)
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


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({}, "dae12"),
        ({"noise": 0.1, "epochs": 200, "batch": 8192}, "dae12"),  # the defaults
        ({"noise": 0.2}, "dae12-noise-0.2"),
        ({"learning_rate": 1e-5, "batch": 64}, "dae12-batch-64-learning_rate-0.00001"),
        ({"initial_weights": "normal"}, "dae12-initial_weights-normal"),
        ({"noise_per": "batch", "rescale": "whitened"}, "dae12-noise_per-batch-whitened"),
        ({**SCRIPT, "epochs": 50}, "dae12-script-epochs-50"),
        ({**SCRIPT, "noise": 0.15, "scale": "sd"}, "dae12-script-noise-0.15-sd"),
    ],
)
def test_every_option_that_is_not_the_default_is_in_the_name(options, name):
    settings = encoder_settings("dae", options, dataset="random/a", latents=12)
    assert settings.representation == name
    asked = named_encoder(name, "face_direction")
    assert asked.representation == name
    assert encoder_settings("dae", asked.options, base=asked.base, dataset="random/a") == settings
    assert kind_in(name) == "dae"


def test_epochs_that_follow_from_the_dataset_are_not_in_the_name():
    settings = encoder_settings("dae", {}, dataset="random/a", episodes=20)
    assert (settings.representation, settings.options["epochs"]) == ("dae12", 2000)
    typed = encoder_settings("dae", {"epochs": 2000}, dataset="random/a", episodes=20)
    assert typed.representation == "dae12-epochs-2000"


def test_names_say_how_to_make_an_encoder():
    command = named_encoder("vae8-hidden-32-sd", "face_direction").command
    assert command == (
        "jbench train-encoder --kind vae --task face_direction --latent 8 --set hidden=32 "
        "--set scale=sd"
    )
    with pytest.raises(RequestError, match="dae has no option noize; did you mean noise"):
        named_encoder("dae12-noize-0.2", "face_direction")


def test_long_options_are_hashed_in_the_name():
    options = {"initial_weights": "normal", "noise_per": "batch", "epochs": 7, "batch": 9}
    settings = encoder_settings("dae", {**options, "noise": 0.2}, dataset="random/a", latents=3)
    assert re.fullmatch(r"dae3-options-[0-9a-f]{8}", settings.representation)
    assert kind_in(settings.representation) == "dae"


@pytest.mark.parametrize("kind", ["planar-no-yaw11", "random-features240", "lld-vae3", "dae-yaw13"])
def test_names_of_kinds_are_not_read_as_options(kind):
    assert kind_in(kind) == kind.rstrip("0123456789")
