"""Made-up datasets to train encoders on, and manifests to alter."""

import json

import numpy as np
import pyarrow as pa

from jbench.datasets import Dataset, layout
from jbench.tasks.features import State


def made_up_states(episodes):
    """States (episodes, 1001) of robots that wobble about, each in its own way."""
    random = np.random.default_rng(episodes)
    shape = (episodes, 1001)
    quaternion = random.normal(size=(*shape, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    place = np.cumsum(random.normal(0, 1e-3, (*shape, 3)), axis=1)
    return State(
        position=np.concatenate([place, quaternion], -1),
        velocity=random.normal(size=(*shape, 6)),
        motor_position=random.uniform(-np.pi, np.pi, shape),
        motor_velocity=random.uniform(-150, 150, shape),
        torso_velocity=random.normal(0, 0.1, (*shape, 3)),
    )


def make_dataset(results, id="random/a", state=None, episodes=5):
    """A finished dataset of these states, all targets at the origin."""
    state = made_up_states(episodes) if state is None else state
    actions = np.zeros((len(state.motor_position), 1000), np.float32)
    targets = {name: np.zeros(len(actions)) for name in layout.EPISODES.names}
    record = results.create("dataset", id, {})
    record.append(
        {
            "steps": layout.steps_table(0, state, actions),
            "dataset_episodes": pa.table(targets).cast(layout.EPISODES),
        }
    )
    record.finish({}, compact=False)
    return Dataset(record)


def alter_manifest(record, **changes):
    """Writes a manifest with other values, as somebody with an editor would."""
    path = record.path / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
