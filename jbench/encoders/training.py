"""From a dataset to a kept encoder with its errors."""

import json
from collections.abc import Callable

import numpy as np
import pyarrow as pa
import safetensors.torch
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from jbench import validation
from jbench.datasets import Dataset
from jbench.encoders import dae
from jbench.encoders.encoder import DESCRIPTION, WEIGHTS
from jbench.errors import RequestError
from jbench.names import LARGEST_SEED
from jbench.store import Record, Results, schema, settings_hash
from jbench.tasks.features import TASK_SPECS, feature_labels

_TEST_SHARE = 0.2  # of the episodes (paper, section 5.2: 20% of the data)


class EncoderSettings(BaseModel):
    """What an encoder is made of; the id is made from it.

    The paper first; where it is silent (batch, epochs), its authors' script.
    """

    model_config = validation.SETTINGS

    kind: str = "dae"
    task: str = "face_direction"
    dataset: str = Field(description="id of the random-policy dataset")
    latents: int = Field(default=12, ge=1, description="paper, Figures 7 and 8")
    noise: float = Field(
        default=0.1, ge=0, description="sd on each scaled feature; paper, section 5.2"
    )
    epochs: int = Field(default=200, ge=1, description="authors' script")
    batch: int = Field(default=8192, ge=1, description="rows; authors' script")
    learning_rate: float = Field(
        default=1e-3, gt=0, description="Adam's default; paper, section 5.2 (script: 5e-4)"
    )
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED)

    @model_validator(mode="after")
    def _reduces(self) -> "EncoderSettings":
        size = TASK_SPECS[self.task].observation_size
        if self.latents > size:
            raise ValueError(f"{self.task} has {size} features: type --latent 1 to {size}")
        return self

    @property
    def representation(self) -> str:
        """What the report calls observations encoded by it, such as dae12."""
        return f"{self.kind}{self.latents}"

    @property
    def id(self) -> str:
        """The encoder's id, such as face_direction/dae12/s00-1f9a2c4e."""
        return (
            f"{self.task}/{self.representation}/s{self.seed:02d}-{settings_hash(self.model_dump())}"
        )


def split_episodes(episodes: int, seed: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the numbers of the episodes to learn from and of those held out, 80 to 20.

    Whole episodes, so that no held-out state is the neighbour of a state learned from.
    """
    order = np.random.default_rng(np.random.SeedSequence(seed)).permutation(episodes)
    held_out = max(1, round(_TEST_SHARE * episodes))
    return np.sort(order[held_out:]), np.sort(order[:held_out])


def train_encoder(
    settings: EncoderSettings,
    dataset: Dataset,
    results: Results,
    progress: Callable[[int], None] = lambda epoch: None,
) -> Record:
    """Trains and keeps an encoder, or finds it finished.

    An unfinished training starts over.

    Args:
        settings: of the encoder.
        dataset: the one that the settings name.
        results: where the encoder goes.
        progress: called with the number of epochs done.

    Raises:
        RequestError: if the dataset has fewer than two episodes.
        WorkError: if another process trains it, or the dataset is damaged.
    """
    record = Record(results, "encoder", settings.id)
    with record.lock():
        found = results.find("encoder", settings.id)
        if found is not None and found.status == "finished":
            return found
        if dataset.episodes < 2:
            raise RequestError(
                f"The dataset {dataset.id} has one episode, and one is held out; type "
                "jbench collect with more --steps."
            )
        observations = dataset.observations(settings.task)
        record = results.create("encoder", settings.id, settings.model_dump())
        learned, held_out = split_episodes(len(observations), settings.seed)
        size = observations.shape[-1]
        training = dae.train(
            observations[learned].reshape(-1, size),
            observations[held_out].reshape(-1, size),
            progress=progress,
            **settings.model_dump(
                include={"latents", "noise", "epochs", "batch", "learning_rate", "seed"}
            ),
        )
        _keep(record, settings, training)
    return record


def _keep(record: Record, settings: EncoderSettings, training: dae.Training) -> None:
    """Commits the rows, the weights and the description of a trained encoder."""
    labels = feature_labels(settings.task)
    errors, variances = training.feature_errors, training.feature_variances
    features = [
        {
            "encoder": record.id,
            "index": index,
            "feature": label,
            "test_mse": errors[index],
            "test_variance": variances[index],
        }
        for index, label in enumerate(labels)
    ]
    epochs = [{"encoder": record.id, **row} for row in training.epochs]
    record.append(
        {
            "encoder_epochs": pa.Table.from_pylist(epochs, schema.ENCODER_EPOCHS),
            "encoder_features": pa.Table.from_pylist(features, schema.ENCODER_FEATURES),
        }
    )
    description = {
        "kind": settings.kind,
        "task": settings.task,
        "latents": settings.latents,
        "features": labels,
        "minimum": training.scaling.minimum.tolist(),
        "maximum": training.scaling.maximum.tolist(),
    }
    last = training.epochs[-1]
    record.finish(
        {"test_mse": last["test_mse"], "wall_time": last["wall_time"]},
        {
            DESCRIPTION: json.dumps(description, indent=1).encode(),
            WEIGHTS: safetensors.torch.save(training.model.state_dict()),
        },
    )
