"""Tests of minibatches half of which are mirror images, against autograd on explicit images."""

import copy

import numpy as np
import pytest
import torch

from jbench.agents.batched.replay import Batch
from jbench.encoders.kinds.linear import PrincipalComponents
from jbench.encoders.kinds.planar import PlanarMirror, PlanarReduction
from jbench.encoders.saved import SavedEncoder
from jbench.encoders.scaling import Scaling
from jbench.errors import RequestError
from jbench.tasks.jitterbug.features import mirrored
from tests.agents.test_batched_engine import STEPS, build_engine, slow
from tests.agents.test_plain_updates import (
    PLAIN,
    assert_equal_parameters,
    copy_parameters,
    paired_layers,
)
from tests.encoders.encoder_data import planar_encoder

TASK = "face_direction"
# With a scaling of the inputs that is exactly symmetric, so are the latents but for theirs.
HALF = np.full(16, 0.5, np.float32)
PLANAR, OTHER_PLANAR = (
    planar_encoder(TASK, PlanarReduction, Scaling(-half, half)) for half in (HALF, 2 * HALF)
)
MIXING = SavedEncoder(
    PrincipalComponents(),
    {"components": np.tri(5, 16, dtype=np.float32), "mean": 0 * HALF},
    Scaling(-HALF, HALF),
    5,
)
MIRROR = {"changes": {"mirror": True}}
ROWS, UPDATES = 42, 6  # two episodes


def replay_rows():
    """Rows of a replay buffer and of their mirror images, without encoder."""
    random = np.random.default_rng(0)
    observations = torch.from_numpy(random.uniform(-1, 1, (ROWS, 16)))
    actions, rewards = torch.from_numpy(random.uniform(-1, 1, (2, ROWS, 1)))
    images = mirrored(TASK, observations)
    return (observations, actions, rewards), (images, -actions, rewards)


def encoded(encoder, observations, actions, rewards):
    inputs = observations if encoder is None else encoder.encode(observations)
    return torch.cat([inputs, actions, rewards], 1)


def update_on_images(algo, plain, settings, rows, images, drawn):
    """Updates a plain rule with minibatches in which 7 of 15 transitions are mirror images.

    `drawn` are the places of transitions and of the next ones in each minibatch, and the noise.
    """
    for update, (sampled, following, noise) in enumerate(zip(*drawn, strict=True), 1):
        now, later = (
            torch.cat([images[indices[:7]], rows[indices[7:]]]) for indices in (sampled, following)
        )
        discounts = torch.full((15, 1), settings.gamma, dtype=torch.float64)
        batch = Batch(now, later, discounts, torch.from_numpy(noise).double())
        if algo == "td3":
            plain.update(batch, update % settings.policy_delay == 0)
        else:
            plain.update(batch)


def assert_updates_equal_autograd(algo, engine, rows, images):
    """Asserts that an engine learns from its replay buffer as a plain rule does from these rows."""
    settings, (learner,), (updates,) = engine._settings, engine.learners, engine.group_updates
    plain = PLAIN[algo][0](settings, engine.environments.size)
    copy_parameters(paired_layers(algo, learner, plain))
    random = copy.deepcopy(engine.environments.generators[0].updates)
    updates.prepare(1, UPDATES)
    sampled, following, _ = engine.replay.sample(random, UPDATES, 15)
    noise = random.standard_normal((UPDATES, 15, learner.noise_per_transition), np.float32)
    update_on_images(algo, plain, settings, rows, images, (sampled, following, noise))
    updates.run()
    assert_equal_parameters(paired_layers(algo, learner, plain))


@pytest.mark.parametrize("encoder", [None, PLANAR], ids=["full", "planar"])
@pytest.mark.parametrize("algo", PLAIN)
def test_updates_equal_autograd_on_explicit_mirror_images(algo, encoder):
    rows, images = (encoded(encoder, *part) for part in replay_rows())
    changes = {"mirror": True, "tau": 0.1, "batch_size": 15}
    with build_engine(algo, [3], encoder=encoder, changes=changes, dtype=torch.float64) as engine:
        engine.replay.restore(0, rows[None], ROWS)
        assert_updates_equal_autograd(algo, engine, rows, images)


@pytest.mark.parametrize("algo", ["td3", slow("ddpg"), slow("sac")])
def test_seed_in_stack_with_other_mirrors_equals_single_seed(algo):
    encoders, seeds = [PLANAR, OTHER_PLANAR], [0, 4]
    options = {"dtype": torch.float64, **MIRROR}
    with build_engine(algo, seeds, encoder=encoders, stacked=True, **options) as engine:
        list(engine.learn(STEPS))
        states = [engine.state(index) for index in range(2)]
    for state, seed, encoder in zip(states, seeds, encoders, strict=True):
        with build_engine(algo, [seed], encoder=encoder, **options) as single:
            list(single.learn(STEPS))
            expected = single.state(0)
        assert state.scalars == expected.scalars
        for name, tensor in expected.tensors.items():
            torch.testing.assert_close(state.tensors[name], tensor, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("encoder", [MIXING, planar_encoder(TASK, PlanarMirror)])
def test_other_representations_are_refused(encoder):
    with pytest.raises(RequestError, match=r"^mirror=true .*: leave it out, or choose"):
        build_engine("td3", [0], encoder=encoder, **MIRROR)
