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
from jbench.policies.saved import Policy, policy_files
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.dataset import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.store import encoder_schema, schema

TASK = "face_direction"
DATASET = "random/s00-5de9f54f"
ENCODER = f"{TASK}/dae12/s00-cfb70956"
RETURNS = {("full", 0): (690, 705), ("full", 1): (747, 330), ("dae12", 0): (112, 197)}
RETURNS["dae12", 1] = (261, 236)
"""Returns of training and of evaluation episodes, by representation and seed."""


def add_demo(results):
    """Fills a results directory: a dataset of two episodes, the encoder, and the runs."""
    collect(DatasetSettings(steps=2000), results, threads=1)
    assert DatasetSettings(steps=50_000).id == DATASET
    _add_encoder(results)
    for (representation, seed), returns in RETURNS.items():
        _add_run(results, representation, seed, *returns)


def _add_encoder(results):
    settings = encoder_settings(
        "dae", {"epochs": 100, "batch": 256}, task=TASK, dataset=DATASET, latents=12, seed=0
    )
    assert settings.id == ENCODER
    random = np.random.default_rng(0)
    shapes = {"encoder.weight": (12, 16), "encoder.bias": (12,)}
    shapes |= {"decoder.weight": (16, 12), "decoder.bias": (16,)}
    weights = {name: random.normal(size=shape).astype("f4") for name, shape in shapes.items()}
    description = {
        "kind": settings.kind,
        "options": settings.options,
        "task": TASK,
        "latents": 12,
        "features": [f"feature {index}" for index in range(16)],
        "minimum": [-1.0] * 16,
        "maximum": [1.0] * 16,
    }
    record = results.create("encoder", settings.id, settings.model_dump())
    errors = dict.fromkeys(encoder_schema.ENCODER_ERRORS.names, 0.5) | {"encoder": settings.id}
    errors |= {"test_states": 1000, "heuristic_states": 1000}
    errors |= {"test_explained": 0.927, "pca_explained": 0.937, "heuristic_explained": 0.919}
    record.append({"encoder_errors": pa.Table.from_pylist([errors], encoder_schema.ENCODER_ERRORS)})
    record.finish(
        {"test_mse": 0.00939, "test_explained": 0.927, "wall_time": 1.0},
        {
            saved.DESCRIPTION: json.dumps(description).encode(),
            saved.WEIGHTS: safetensors.numpy.save(weights),
        },
    )


def _add_run(results, representation, seed, training, evaluation):
    changes = {"hidden_layers": [128, 128], "batch_size": 64}
    changes |= {"learning_rate": 1e-3, "learning_starts": 5000}
    settings = RunSettings(
        task=TASK,
        algo="td3",
        representation=representation,
        encoder=None if representation == "full" else ENCODER,
        seed=seed,
        steps=25_000,
        evaluate_every=50_000,
        evaluate_episodes=5,
        hyperparameters=algorithm_settings("td3", overrides=changes).model_dump(mode="json"),
    )
    record = results.create("run", settings.id, settings.model_dump(mode="json"))
    common = {"run": settings.id, "length": 1000}
    episodes = [
        common
        | {"episode": episode, "control_steps": 1000 * (episode + 1)}
        | {"episode_return": training, "wall_time": 4.0 * episode}
        for episode in range(25)
    ]
    evaluations = [
        common
        | {"evaluation": 0, "control_steps": 25_000, "episode": episode}
        | {"episode_return": evaluation, "wall_time": 120.0}
        for episode in range(5)
    ]
    record.append(
        {
            "episodes": pa.Table.from_pylist(episodes, schema.EPISODES),
            "evaluations": pa.Table.from_pylist(evaluations, schema.EVALUATIONS),
        }
    )
    record.finish({"wall_time": 120.0, "steps_done": 25_000}, policy_files(_policy(representation)))


def _policy(representation):
    sizes = (16 if representation == "full" else 12, 8, 1)
    random = np.random.default_rng(1)
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    weights = [random.normal(size=pair).astype("f4") for pair in pairs]
    return Policy(weights, [np.zeros(units, "f4") for units, _ in pairs], "tanh")
