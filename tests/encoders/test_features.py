"""Tests of the option `features`: encoders of parts of an observation."""

from types import SimpleNamespace

import numpy as np
import pytest
import safetensors.numpy
import torch

from jbench.encoders import find_draws, find_encoder, load_encoder
from jbench.encoders.features import columns, from_name, in_name, shortest
from jbench.encoders.representations import named_encoder
from jbench.encoders.saved import WEIGHTS
from jbench.encoders.scaling import Scaling
from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.errors import RequestError
from jbench.representation_names import features_in, kind_in
from jbench.store import Results
from jbench.tasks.jitterbug.features import denormalize
from tests.encoders.encoder_data import observations_of, train

TASK = "move_in_direction"
WITHOUT_SPEED = {"features": "-speed_in_target_frame"}
NAME = "without-speed_in_target_frame"


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path)


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        (None, range(19)),
        (["position_x", "velocity"], [0, *range(7, 13)]),
        (["-speed_in_target_frame"], range(16)),
        (["position", "-position_qw", "-position_z"], [0, 1, 4, 5, 6]),
        (["-velocity", "velocity_angular_z"], [*range(7), *range(12, 19)]),
    ],
)
def test_names_add_and_with_a_minus_take_away(typed, expected):
    assert columns(TASK, typed) == list(expected)
    assert columns(TASK, shortest(TASK, typed)) == list(expected)


@pytest.mark.parametrize(
    ("typed", "expected", "name"),
    [
        # Of the part arm, arm_0 is the first value; typed, it is the part of this name.
        (["arm", "-arm_1"], [0], "without-arm_1.arm_0.arm.x.x.y"),
        (["arm_0"], [2], "of-arm_0"),
        (["arm.x", "x"], [3, 4], "of-arm.x.x"),
        (["-arm.x"], [0, 1, 2, 4, 5], "without-arm.x"),
    ],
)
def test_name_is_of_its_features_where_parts_have_dots_or_are_called_as_values(
    typed, expected, name, monkeypatch
):
    parts = {"arm": 2, "arm_0": 1, "arm.x": 1, "x": 1, "y": 1}
    labels = ["arm_0", "arm_1", "arm_0", "arm.x", "x", "y"]
    about = SimpleNamespace(parts=parts, labels=labels, observation_size=6)
    monkeypatch.setattr("jbench.encoders.features.find_task", lambda task: about)
    assert columns("odd", typed) == expected
    assert in_name(shortest("odd", typed)) == name
    assert columns("odd", from_name(name, "odd")) == expected


def test_one_set_of_features_has_one_id_however_it_is_typed():
    kept = "position,velocity,motor_position,motor_velocity,angle_to_target"
    typed = ["-speed_in_target_frame", kept, ["-speed_in_target_frame"]]
    about = {"task": TASK, "dataset": "random/a", "latents": 12}
    made = [encoder_settings("dae", {"features": some}, **about) for some in typed]
    assert {settings.representation for settings in made} == {f"dae12-{NAME}"}
    assert len({settings.id for settings in made}) == 1

    everything = encoder_settings("dae", {"features": "-position,position"}, **about)
    assert everything == encoder_settings("dae", {}, **about)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ("speed_in_target", "did you mean speed_in_target_frame"),
        ("-speed_in_target_frame,x", "angle_to_target, speed_in_target_frame"),
        ("position,-position", "leaves no feature of move_in_direction"),
    ],
)
def test_features_that_do_not_exist_are_refused(features, message):
    with pytest.raises(RequestError, match=message):
        encoder_settings("dae", {"features": features}, task=TASK, dataset="random/a", latents=2)


@pytest.mark.parametrize("kind", ["planar", "dae-yaw"])
def test_kinds_of_the_whole_observation_refuse_the_option(kind):
    with pytest.raises(RequestError, match=f"{kind} needs all features of the observation"):
        encoder_settings(kind, WITHOUT_SPEED, task=TASK, dataset="random/a", latents=12)


@pytest.mark.parametrize("memory", [2**30, 600_000])
def test_encoder_sees_only_its_features(trained, results, memory):
    states = States(trained.dataset, TASK, 2, memory=memory)
    record = train(states, results, "dae", 3, WITHOUT_SPEED)
    encoder, description = load_encoder(results, record.id)
    assert description["features"][-1] == "angle_to_target"

    seen = observations_of(trained.dataset, TASK)[0]
    scaling = Scaling(*(np.array(description[name]) for name in ("minimum", "maximum")))
    gain, offset = scaling.gain_and_offset()
    weights = safetensors.numpy.load(record.read_file(WEIGHTS))
    affine = (seen[:, :16] * gain + offset) @ weights["encoder.weight"].T + weights["encoder.bias"]
    np.testing.assert_allclose(encoder.encode(seen), np.tanh(affine), atol=1e-5)
    tensors = encoder.encode(torch.from_numpy(seen)).numpy()
    np.testing.assert_allclose(tensors, np.tanh(affine), atol=1e-5)

    assert len(record.read("encoder_features")) == 16
    assert {"yaw_rate", "reward"} <= {*record.read("encoder_predictions")["target"].to_pylist()}


def test_raw_features_are_in_si_units_and_scaled_ones_between_their_extremes(trained, results):
    seen = observations_of(trained.dataset, TASK)
    states = States(trained.dataset, TASK, 0)
    latents = {}
    for kind in ("raw", "scaled"):
        record = train(states, results, kind, 16, WITHOUT_SPEED)
        assert record.path.parent.name == f"{kind}16-{NAME}"
        latents[kind] = load_encoder(results, record.id).encoder.encode(seen)
    physical = denormalize(TASK, seen.astype(np.float64))[..., :16]
    np.testing.assert_allclose(latents["raw"], physical, rtol=1e-3, atol=1e-4)
    assert np.abs(latents["scaled"]).max() <= 1 + 1e-5


def test_encoder_of_some_features_is_found_by_its_short_name_only(trained, results):
    states = States(trained.dataset, TASK, 2)
    whole = train(states, results, "pca", 3)
    some = train(states, results, "pca", 3, WITHOUT_SPEED)
    assert find_encoder(results, "pca3", TASK) == whole.id
    assert find_encoder(results, f"pca3-{NAME}", TASK) == some.id
    assert find_draws(results, f"pca3-{NAME}", TASK, [2]).ids == {2: some.id}


def test_missing_encoder_names_the_command_that_makes_it(results):
    with pytest.raises(RequestError, match="--kind raw --task move_in_direction --set features=-s"):
        find_encoder(results, f"raw-{NAME}", TASK)
    assert named_encoder(f"raw-{NAME}", TASK).representation == f"raw16-{NAME}"
    with pytest.raises(RequestError, match="has 1 to 16 latents; choose dae12-without-speed"):
        named_encoder(f"dae19-{NAME}", TASK)


def test_observations_of_another_size_are_refused(trained, results):
    record = train(States(trained.dataset, TASK, 2), results, "pca", 3, WITHOUT_SPEED)
    encoder = load_encoder(results, record.id).encoder
    with pytest.raises(ValueError, match="observations of 16 numbers instead of 19"):
        encoder.encode(np.zeros(16, np.float32))


def test_report_can_tell_kind_and_features_from_the_name():
    assert kind_in(f"raw16-{NAME}") == "raw"
    assert features_in(f"raw16-{NAME}") == features_in(f"dae12-{NAME}-whitened") == NAME
    assert features_in("dae12-observation") == features_in("full") == ""


def test_long_lists_of_features_have_a_hash_in_the_name():
    features = ["position_x", "position_qw", "velocity_x", "velocity_z", "velocity_angular_y"]
    settings = encoder_settings(
        "dae", {"features": features}, task=TASK, dataset="random/a", latents=2
    )
    assert len(settings.representation) == len("dae2-features-01234567")


def test_training_of_the_script_has_its_name_however_it_is_typed():
    options = {"initial_weights": "normal", "noise_per": "batch", "learning_rate": 5e-4}
    typed = encoder_settings("dae", options, dataset="random/a", latents=12)
    named = encoder_settings("dae", {}, base="script", dataset="random/a", latents=12)
    assert typed == named
    assert typed.representation == "dae12-script"
    assert typed.options["epochs"] == 200
    assert named_encoder("dae12-script", "face_direction").command == (
        "jbench train-encoder --kind dae --task face_direction --latent 12 --settings script"
    )
    with pytest.raises(RequestError, match="for dae, not for pca"):
        encoder_settings("pca", {}, base="script", dataset="random/a", latents=12)
