"""Tests of the planar reduction folded by the mirror."""

import math

import numpy as np
import torch
from hypothesis import assume, given

from jbench.encoders import action_signs
from jbench.encoders.kinds.planar import PlanarReduction
from jbench.encoders.kinds.planar_variants import PlanarMirror
from jbench.encoders.predictions import predictions
from jbench.encoders.training import fitted
from jbench.task_specs import TASK_SPECS
from jbench.tasks import features, geometry
from jbench.tasks.geometry import State, Target
from tests.encoders.encoder_data import (
    make_dataset,
    planar_encoder,
    random_states,
    read_states,
)
from tests.encoders.test_planar import at_origin, robots, tasks


def image_of(state, target):
    """The reflection of a robot and its target at the plane x = 0."""
    axial, polar = np.array([1, -1, -1]), np.array([-1, 1, 1])
    w, x, y, z = state.position[3:]
    return (
        State(
            np.array([*(polar * state.position[:3]), w, x, -y, -z]),
            np.array([*(polar * state.velocity[:3]), *(axial * state.velocity[3:])]),
            -state.motor_position,
            -state.motor_velocity,
            polar * state.torso_velocity,
        ),
        Target(polar * target.position, math.pi - target.yaw),
    )


def side_of(task, state, target):
    """The angle or the lateral way to the target, positive on the left, and whether it is clear."""
    if "angle_to_target" in TASK_SPECS[task].features:
        angle = geometry.angle_to_target(state, target)
        return angle, 1e-3 < abs(angle) < math.pi - 1e-3
    way = (target.position - state.position[:3])[:2]
    # The robot's left is the x axis of its frame, turned by the twist of its orientation.
    twist = 2 * math.atan2(state.position[6], state.position[3])
    lateral = math.cos(twist) * way[0] + math.sin(twist) * way[1]
    return lateral, abs(lateral) > 1e-3


@given(tasks, robots)
def test_state_and_mirror_image_have_equal_latents_and_opposite_actions(task, found):
    state, target = found[0], at_origin(task, found[1])
    side, is_clear = side_of(task, state, target)
    assume(is_clear)
    encoder, plain = planar_encoder(task, PlanarMirror), planar_encoder(task, PlanarReduction)
    both = np.stack(
        [features.observation(task, *each) for each in ((state, target), image_of(state, target))]
    )
    seen = torch.from_numpy(both)
    latents, signs = encoder.encode(seen), action_signs(encoder, seen)
    # In half of the observations' range, the encoder's numbers in float32 are 1e-7 from an image.
    torch.testing.assert_close(latents[0], latents[1], rtol=0, atol=1e-4)
    assert signs.tolist() == [[1.0], [-1.0]] if side > 0 else [[-1.0], [1.0]]
    # What is not reflected is the planar reduction itself.
    left = int(side < 0)
    assert torch.equal(latents[left], plain.encode(seen)[left])


def test_probe_predicts_mirrored_robot(results):
    # States that last for ten control steps, so that the next rates follow from the latents.
    state = State(*(np.repeat(part[:, ::10], 10, axis=1)[:, :1001] for part in random_states(5)))
    states = read_states(make_dataset(results, state=state))
    for kind in (PlanarReduction(), PlanarMirror()):
        for row in predictions(kind, fitted(kind, states, 12), states):
            assert row["r2"] > 0.6 or row["target"] == "reward"
