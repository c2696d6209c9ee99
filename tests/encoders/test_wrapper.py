"""Tests of encoded environments, and of the mirror of an agent's inputs."""

import gymnasium
import numpy as np
import pytest
import torch

from jbench.encoders import load_encoder
from jbench.encoders.kinds.linear import Scaled
from jbench.encoders.kinds.planar import PlanarMirror, PlanarReduction
from jbench.encoders.saved import SavedEncoder
from jbench.encoders.wrapper import EncodedObservation, input_mirror
from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.tasks.jitterbug.features import mirrored, observation_size
from tests.encoders.encoder_data import planar_encoder, range_without_symmetry


def scaled(task):
    """An encoder of a scaling that is not symmetric, with a constant first feature."""
    scaling = range_without_symmetry(observation_size(task))
    scaling.minimum[0] = scaling.maximum[0] = 0.5
    return SavedEncoder(Scaled(), {}, scaling, len(scaling.minimum))


@pytest.mark.parametrize(
    "encoder_of",
    [lambda task: None, scaled, lambda task: planar_encoder(task, PlanarReduction)],
)
@pytest.mark.parametrize("task", TASKS)
def test_inputs_of_mirror_images_are_gain_times_inputs_plus_offset(task, encoder_of):
    encoder = encoder_of(task)
    gain, offset = input_mirror(task, encoder)
    size = observation_size(task)
    seen = torch.from_numpy(np.random.default_rng(9).uniform(-1, 1, (50, size)))
    inputs, images = seen, mirrored(task, seen)
    if encoder is not None:
        inputs, images = encoder.encode(inputs), encoder.encode(images)
    expected = torch.from_numpy(gain) * inputs + torch.from_numpy(offset)
    torch.testing.assert_close(images, expected, rtol=1e-5, atol=1e-5)
    # The mirror of a mirror changes nothing.
    assert set(np.abs(gain)) == {1}
    np.testing.assert_array_equal(offset[gain == 1], 0)
    assert 7 <= (gain < 0).sum() <= 10


def test_encoder_that_is_mirrored_already_is_refused():
    with pytest.raises(RequestError, match="such as planar-mirror: leave it out"):
        input_mirror("face_direction", planar_encoder("face_direction", PlanarMirror))


def test_encoded_environment_observes_latents(trained):
    encoder = load_encoder(trained.results, trained.record.id).encoder
    plain = gymnasium.make(environment_id("face_direction"))
    encoded = EncodedObservation(gymnasium.make(environment_id("face_direction")), encoder)
    assert encoded.observation_space.shape == (3,)
    pairs = [(plain.reset(seed=0)[0], encoded.reset(seed=0)[0])]
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 1)).astype(np.float32):
        (seen, *others), (latents, *encoded_others) = plain.step(action), encoded.step(action)
        assert others == encoded_others  # reward, end and information are unchanged
        pairs.append((seen, latents))
    for seen, latents in pairs:
        np.testing.assert_array_equal(latents, encoder.encode(seen))
        assert encoded.observation_space.contains(latents)


def test_environment_of_other_task_is_not_encoded(trained):
    encoder = load_encoder(trained.results, trained.record.id).encoder
    with pytest.raises(RequestError, match=r"can't encode observations of shape \(19,\)"):
        EncodedObservation(gymnasium.make(environment_id("move_to_pose")), encoder)
