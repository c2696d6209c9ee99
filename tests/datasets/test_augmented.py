"""Tests of datasets of augmented robots: id, content and invalid requests."""

import hashlib
import json

import mujoco
import numpy as np
import pytest

from jbench import cli
from jbench.datasets import Dataset, collect
from jbench.datasets.jitterbug import read_state
from jbench.names import TASKS
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from jbench.tasks.jitterbug import geometry, model, resets
from jbench.tasks.jitterbug.rewards import reward
from jbench.tasks.jitterbug.robots import load_model
from tests.short_episodes import short_episodes

SEED, AUGMENT = 3, 11
EPISODE = 100
"""Control steps of an episode in these tests."""
STEPS = 2 * EPISODE


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with short_episodes(EPISODE):
        yield


@pytest.fixture(scope="module")
def augmented(tmp_path_factory):
    settings = DatasetSettings(seed=SEED, steps=STEPS, augment=AUGMENT)
    return collect(settings, Results(tmp_path_factory.mktemp("augmented")), 2)


def simulate_again(robot, episodes):
    """Simulates the dataset's episodes with a robot, drawn as documented."""
    quaternions, targets, actions = [], [], []
    for episode in range(episodes):
        random = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(episode,)))
        quaternions.append(resets.draw_quaternion(random))
        targets.append({task: resets.draw_target(task, random) for task in TASKS})
        actions.append(random.uniform(-1, 1, EPISODE).astype(np.float32))
    data, qpos, qvel = mujoco.MjData(robot), [], []
    for quaternion, commands in zip(quaternions, actions, strict=True):
        model.place(data, quaternion)
        for command in (None, *commands):
            if command is not None:
                data.ctrl[0] = command
                mujoco.mj_step(robot, data, nstep=50)
            qpos.append(data.qpos.copy())
            qvel.append(data.qvel.copy())
    states = (np.reshape(part, (episodes, EPISODE + 1, -1)) for part in (qpos, qvel))
    return model.read_state(*states, model.torso_offset(robot)), np.stack(actions)


def test_robot_is_part_of_settings_and_id_only_if_augmented(augmented):
    plain = DatasetSettings(seed=SEED, steps=STEPS)
    # The documented example, and the JSON that is hashed.
    assert DatasetSettings(steps=100_000).id == "random/s00-d4a8116b"
    kept = {"policy": "random", "robot": "jitterbug", "seed": SEED, "steps": STEPS}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"))
    assert plain.id == f"random/s03-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    assert plain.model_dump(mode="json") == kept
    assert augmented.settings == {**kept, "augment": AUGMENT}
    ids = {plain.id, augmented.id, DatasetSettings(seed=SEED, steps=STEPS, augment=0).id}
    assert len(ids) == 3


def test_states_equal_simulation_of_augmented_robot(augmented):
    expected, actions = simulate_again(load_model(AUGMENT), 2)
    found = read_state(augmented.read("steps"), EPISODE)
    for name in ("position", "velocity", "motor_velocity", "torso_velocity"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-5, atol=1e-6, err_msg=name
        )
    # The only task with a fixed target, the origin.
    (block,) = Dataset(augmented).blocks("move_from_origin")
    np.testing.assert_array_equal(block.actions, actions)
    xyz = np.broadcast_to([0, 0, model.REST_HEIGHT], (2, EPISODE + 1, 3))
    origin = geometry.Target(xyz, np.zeros((2, EPISODE + 1)))
    rewards = reward("move_from_origin", expected, origin)[:, 1:]
    np.testing.assert_allclose(block.rewards, rewards, atol=1e-5)


def test_command_collects_with_requested_robot(tmp_path, augmented):
    command = ["collect", "--steps", str(STEPS), "--seed", str(SEED), "--augment", str(AUGMENT)]
    assert cli.main([*command, "--results", str(tmp_path)]) == 0
    (record,), _ = Results(tmp_path).scan("dataset")
    assert record.id == augmented.id
    assert [entry.sha256 for entry in record.manifest.files] == [
        entry.sha256 for entry in augmented.manifest.files
    ]
