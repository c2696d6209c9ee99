"""Synthetic datasets to train encoders on."""

import numpy as np
import pyarrow as pa
import torch

from jbench.datasets import Dataset
from jbench.datasets.jitterbug import steps_table
from jbench.encoders.kind import Learned
from jbench.encoders.kinds.planar import planar_weights
from jbench.encoders.registry import find_kind
from jbench.encoders.saved import SavedEncoder
from jbench.encoders.scaling import Scaling
from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.names import TASKS
from jbench.store import schema
from jbench.tasks.jitterbug.features import observation_size
from jbench.tasks.jitterbug.geometry import State
from tests.tasks import robot_states

CHEAP = {"epochs": 5, "batch": 500}
PLANAR_SIZES = dict(zip(TASKS, (13, 12, 12, 13, 14), strict=True))


def random_states(episodes):
    return robot_states.random_states((episodes, 1001), seed=episodes)[0]


def random_actions(episodes):
    return np.random.default_rng(episodes + 1).uniform(-1, 1, (episodes, 1000)).astype(np.float32)


def make_dataset(results, id="random/a", state=None, episodes=5, each=25):
    """A finished dataset of these states with targets at the origin."""
    state = random_states(episodes) if state is None else state
    episodes = len(state.motor_position)
    actions = random_actions(episodes)
    record = results.create("dataset", id, {})
    for first in range(0, episodes, each):
        part = slice(first, first + each)
        numbers = np.arange(episodes)[part]
        targets = {name: np.zeros(len(numbers)) for name in schema.DATASET_EPISODES.names}
        record.append(
            {
                "steps": steps_table(
                    first, State(*(values[part] for values in state)), actions[part]
                ),
                "dataset_episodes": pa.table(targets | {"episode": numbers}).cast(
                    schema.DATASET_EPISODES
                ),
            }
        )
    record.finish({}, join=False)
    return Dataset(record)


def read_states(dataset, task="face_direction", seed=2, **more):
    states = States(dataset, task, seed, **more)
    states.read(torch.device("cpu"))
    return states


def train(states, results, kind="dae", latents=3, options=None, **more):
    """Trains an encoder on states, and returns its record.

    Args:
        options: of the kind; there are five epochs of small batches, if it has any.
        more: other arguments of `train_encoder`.
    """
    cheap = CHEAP if issubclass(find_kind(kind), Learned) else {}
    about = {"dataset": states.dataset.id, "task": states.task, "seed": states.seed}
    settings = encoder_settings(kind, {**cheap, **(options or {})}, latents=latents, **about)
    return train_encoder(settings.without_names, states, results, **more)


def rows(record, table="encoder_epochs"):
    return record.read(table).to_pandas()


def fitted_encoder(kind, states, latents=None):
    latents = latents or kind.latent_sizes(states.task, states.size)[0]
    weights = {n: value.astype(np.float32) for n, value in kind.fit(states, latents).items()}
    return SavedEncoder(kind, weights, states.scaling, latents)


def observations_of(dataset, task="face_direction"):
    """All observations (episodes, 1001, size), the last after the last action."""
    return np.concatenate([block.observations for block in dataset.blocks(task)])


def range_without_symmetry(size):
    low, high = -np.random.default_rng(size).uniform(0.2, 1, (2, size)).astype(np.float32)
    return Scaling(low, high + 2)


def planar_encoder(task, kind, inputs=None):
    """An encoder of the kind of `planar`; the scaling of its inputs is by default not symmetric."""
    size = len(kind.columns(task))
    inputs = inputs or range_without_symmetry(observation_size(task))
    offset = np.array([0.001, -0.002, 0.004])
    weights = planar_weights(task, inputs, range_without_symmetry(size), offset)
    weights = {name: value.astype(np.float32) for name, value in weights.items()}
    return SavedEncoder(kind(), weights, inputs, size)
