"""Builds results like those of `make demo` in docs/quick-start.md, without training.

Settings and ids equal those of the commands on that page, returns on the full observation those
that it shows. The policies and the encoder have random weights.
"""

import json

import numpy as np
import pyarrow as pa
import safetensors.numpy

from jbench.datasets import collect
from jbench.encoders import saved
from jbench.encoders.settings import encoder_settings
from jbench.policies.layer_sequences import relu_layers
from jbench.policies.layers import Linear
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.store import schema

TASK = "face_direction"
DATASET = "random/s00-5de9f54f"
ENCODER = f"{TASK}/dae14/s00-99f840bb"
RETURNS = {("full", 0): (320, 494), ("full", 1): (478, 854), ("dae14", 0): (380, 518)}
RETURNS["dae14", 1] = (630, 970)
"""Returns of training episodes and of the last evaluation, by representation and seed."""


def add_demo(results):
    """Fills a results directory: a dataset of two episodes, the encoder, and the runs."""
    collect(DatasetSettings(steps=2000), results, threads=1)
    assert DatasetSettings(steps=50_000).id == DATASET
    _add_encoder(results)
    for (representation, seed), returns in RETURNS.items():
        _add_run(results, representation, seed, *returns)


def _add_encoder(results):
    settings = encoder_settings(
        "dae", {}, task=TASK, dataset=DATASET, episodes=50, latents=14, seed=0
    )
    assert settings.options["epochs"] == 800
    assert settings.id == ENCODER
    random = np.random.default_rng(0)
    shapes = {"encoder.weight": (14, 16), "encoder.bias": (14,)}
    shapes["decoder.weight"] = (16, 14)
    shapes["decoder.bias"] = (16,)
    weights = {name: random.normal(size=shape).astype("f4") for name, shape in shapes.items()}
    description = {"kind": settings.kind, "options": settings.options, "task": TASK, "latents": 14}
    description["features"] = [f"feature {index}" for index in range(16)]
    description["minimum"] = [-1.0] * 16
    description["maximum"] = [1.0] * 16
    record = results.create("encoder", settings.id, settings.model_dump())
    errors = dict.fromkeys(schema.TABLES["encoder_errors"].names, 0.5) | {"encoder": settings.id}
    errors["test_states"] = 1000
    errors["heuristic_states"] = 1000
    errors["test_explained"] = 0.959
    errors["pca_explained"] = 0.976
    errors["heuristic_explained"] = 0.977
    record.append(
        {"encoder_errors": pa.Table.from_pylist([errors], schema.TABLES["encoder_errors"])}
    )
    files = {saved.DESCRIPTION: json.dumps(description).encode()}
    files[saved.WEIGHTS] = safetensors.numpy.save(weights)
    record.finish({"test_mse": 0.00537, "test_explained": 0.959, "wall_time": 1.0}, files)


def _add_run(results, representation, seed, training, evaluation):
    changes = {"hidden_layers": [128, 128], "batch_size": 64}
    changes["learning_rate"] = 1e-3
    changes["learning_starts"] = 5000
    settings = RunSettings(
        task=TASK,
        algo="td3",
        representation=representation,
        encoder=None if representation == "full" else ENCODER,
        seed=seed,
        steps=20_000,
        evaluate_every=2000,
        evaluate_episodes=2,
        hyperparameters=algorithm_settings("td3", overrides=changes).model_dump(mode="json"),
    )
    record = results.create("run", settings.id, settings.model_dump(mode="json"))
    common = {"run": settings.id, "length": 1000}
    episodes = [
        common
        | {"episode": episode, "control_steps": 1000 * (episode + 1)}
        | {"episode_return": training, "wall_time": 4.0 * episode}
        for episode in range(20)
    ]
    evaluations = [
        common
        | {"evaluation": number, "control_steps": 2000 * (number + 1), "episode": episode}
        | {"episode_return": evaluation * (number + 1) / 10, "wall_time": 12.0 * (number + 1)}
        for number in range(10)
        for episode in range(2)
    ]
    record.append({"episodes": pa.Table.from_pylist(episodes, schema.EPISODES)})
    record.append({"evaluations": pa.Table.from_pylist(evaluations, schema.EVALUATIONS)})
    record.finish({"wall_time": 120.0, "steps_done": 20_000}, _policy(representation).files())


def _policy(representation):
    random = np.random.default_rng(1)
    linear = [
        Linear(weight=random.normal(size=shape).astype("f4"), bias=np.zeros(shape[0], "f4"))
        for shape in ((8, 16 if representation == "full" else 14), (1, 8))
    ]
    return SavedNetwork(relu_layers(linear, "tanh"))
