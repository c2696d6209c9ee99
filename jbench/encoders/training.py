"""Training, evaluating and saving an encoder."""

import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import safetensors.numpy
import torch
from numpy.typing import NDArray

from jbench.cores import one_thread
from jbench.encoders.evaluation import error_tables
from jbench.encoders.kind import ClosedForm, Fitted, Kind, Learned
from jbench.encoders.loop import EncoderLearner, check_kind
from jbench.encoders.pairs import StatePairs
from jbench.encoders.predictions import predictions
from jbench.encoders.registry import code_provenance, make_kind
from jbench.encoders.saved import DESCRIPTION, WEIGHTS, SavedEncoder
from jbench.encoders.scaling import rescaling
from jbench.encoders.settings import EncoderSettings
from jbench.encoders.states import States
from jbench.errors import WorkError
from jbench.names import ENCODER_KINDS
from jbench.simulation import find_task
from jbench.store import Record, Results, encoder_schema
from jbench.store.provenance import device_provenance

CHECKPOINT = "checkpoint.safetensors"

_COMMIT_EVERY = 15.0  # s between checkpoints

WeightArrays = dict[str, NDArray[np.float32]]


def train_encoder(
    settings: EncoderSettings,
    states: States,
    results: Results,
    progress: Callable[[int], None] = lambda epoch: None,
    *,
    device: torch.device = torch.device("cpu"),  # noqa: B008 - a constant
    commit_every: float = _COMMIT_EVERY,
) -> Record:
    """Trains and saves an encoder, resumes its training, or returns the finished one.

    A resumed training ends with the same weights, bit for bit, as an uninterrupted one. Rescaled
    latents are those of the finished encoder without `rescale`, if the results contain it.

    Args:
        states: of the settings' dataset, task and seed; several encoders can share them.
        progress: called with the number of completed epochs; a closed form has one.
        commit_every: minimum seconds between checkpoints, which are written after an epoch.

    Raises:
        ValueError: if the states are not those of the settings, or have another scale.
        WorkError: if another process trains it, the dataset is damaged, a method of its kind fails,
            or the training diverges.
    """
    kind = make_kind(settings.kind, settings.options)
    if (states.dataset.id, states.task, states.seed, states.scale) != (
        *(settings.dataset, settings.task, settings.seed, kind.scale),
    ):
        raise ValueError(f"these are not the states of {settings.id}")
    with results.locked("encoder", settings.id) as record:
        if record is not None and record.status == "finished":
            return record
        states.read(device)
        if isinstance(kind, Learned) and settings.kind not in ENCODER_KINDS:
            check_kind(kind, settings.kind, states, settings.latents)
        if record is None or CHECKPOINT not in record.roles():
            made_on = device_provenance(device) | code_provenance(settings.kind)
            record = results.create("encoder", settings.id, settings.model_dump(), made_on)
        training = _Training(kind, settings, states, record, device, progress, commit_every)
        with one_thread():
            weights = _trained_without_rescale(settings, record, results)
            if weights is None:
                weights = training.weights()
            if kind.rescale is not None:
                weights |= rescaling(kind.rescale, _latents(kind, weights, states))
            try:
                SavedEncoder(kind, weights, states.scaling, settings.latents)
            except ValueError as error:
                raise WorkError(f"The encoder {settings.id} can't be used: {error}.") from None
            # An interrupted process may have committed the errors already.
            if not record.rows("encoder_errors"):
                table_rows = [
                    {"encoder": record.id, **row} for row in predictions(kind, weights, states)
                ]
                table = pa.Table.from_pylist(table_rows, encoder_schema.ENCODER_PREDICTIONS)
                errors = error_tables(record.id, kind, weights, settings.latents, states)
                record.append({**errors, "encoder_predictions": table})
        training.finish(weights)
    return record


def _trained_without_rescale(
    settings: EncoderSettings, record: Record, results: Results
) -> WeightArrays | None:
    """Returns the weights of the encoder that differs only in `rescale`, and copies its epochs."""
    options = {name: value for name, value in settings.options.items() if name != "rescale"}
    if len(options) == len(settings.options) or record.rows("encoder_epochs"):
        return None
    plain = settings.model_copy(update={"options": options})
    trained = results.find("encoder", plain.id)
    if trained is None or trained.status != "finished":
        return None
    epochs = trained.read("encoder_epochs").to_pylist()
    rows = [{**row, "encoder": record.id} for row in epochs]
    record.append({"encoder_epochs": pa.Table.from_pylist(rows, encoder_schema.ENCODER_EPOCHS)})
    return safetensors.numpy.load(trained.read_file(WEIGHTS))


def _latents(kind: Kind, weights: WeightArrays, states: States) -> Iterator[NDArray[np.float32]]:
    """Yields the latents (rows, latents) of the training states."""
    for shard in states.learn():
        for batch in shard.blocks(0):
            yield kind.encode(weights, batch.now.cpu().numpy())


@dataclass
class _Training:
    """The training of one encoder; see `train_encoder`."""

    kind: Kind
    settings: EncoderSettings
    states: States
    record: Record
    device: torch.device
    progress: Callable[[int], None]
    commit_every: float

    def weights(self) -> WeightArrays:
        """Returns the trained weights as numpy arrays in float32."""
        kind, states, latents = self.kind, self.states, self.settings.latents
        if isinstance(kind, Learned):
            learner = EncoderLearner(kind, states, latents)
            if CHECKPOINT in self.record.roles():
                learner.restore(self.record.read_file(CHECKPOINT))
            self._learn(learner)
            return learner.arrays()
        if isinstance(kind, Fitted):
            fitted = kind.fit(states, latents)
        else:
            assert isinstance(kind, ClosedForm)
            fitted = kind.fit(states.learned, latents, states.seed)
        self.progress(1)
        return {name: np.ascontiguousarray(v, np.float32) for name, v in fitted.items()}

    def _learn(self, learner: EncoderLearner) -> None:
        """Trains the remaining epochs and commits their rows with checkpoints."""
        kind, sample, record = learner.kind, self.states.sample, self.record
        numbers = torch.arange(sample.pairs(kind.steps_ahead), device=self.device)
        clean = sample.take(numbers, kind.steps_ahead, kind.uses_actions)
        # A separate generator: measuring an error must not change the training.
        corrupted = kind.prepare(clean, learner.latents, torch.Generator().manual_seed(0))
        same = corrupted.now is clean.now
        done = record.read("encoder_epochs").to_pylist()
        before = done[-1]["wall_time"] if done else 0.0
        rows: list[dict[str, Any]] = []
        start, committed = time.perf_counter(), -math.inf
        self.progress(len(done))
        for epoch in range(len(done) + 1, kind.epochs + 1):
            loss = learner.epoch()
            if not math.isfinite(loss):
                raise WorkError(
                    f"The training of {record.id} diverged: the loss of epoch {epoch} is {loss}; "
                    "type a smaller --learning-rate."
                )
            errors = {
                "test_mse": _error(learner, clean, clean),
                "test_denoising_mse": None if same else _error(learner, corrupted, clean),
            }
            now = time.perf_counter()
            row = {"encoder": record.id, "epoch": epoch, "train_loss": loss, **errors}
            rows.append({**row, "wall_time": before + now - start})
            if now - committed >= self.commit_every or epoch == kind.epochs:
                table = pa.Table.from_pylist(rows, encoder_schema.ENCODER_EPOCHS)
                record.append({"encoder_epochs": table}, {CHECKPOINT: learner.to_bytes()})
                rows, committed = [], now
            self.progress(epoch)

    def finish(self, weights: WeightArrays) -> None:
        """Commits the weights and the description of the trained encoder."""
        settings, record, scaling = self.settings, self.record, self.states.scaling
        description = {
            **{name: getattr(settings, name) for name in ("kind", "options", "task", "latents")},
            "features": find_task(settings.task).labels,
            "minimum": scaling.minimum.tolist(),
            "maximum": scaling.maximum.tolist(),
        }
        (totals,) = record.read("encoder_errors").to_pylist()
        epochs = record.read("encoder_epochs").to_pylist()
        predicted = record.read("encoder_predictions").to_pylist()
        names = ("test_mse", "test_explained", "pca_explained", "heuristic_explained")
        record.finish(
            {
                **{name: totals[name] for name in names},
                "effective_rank": predicted[0]["effective_rank"] if predicted else None,
                **self.kind.summary(weights),
                "wall_time": epochs[-1]["wall_time"] if epochs else None,
                "device": self.device.type,
            },
            {
                DESCRIPTION: json.dumps(description, indent=1).encode(),
                WEIGHTS: safetensors.numpy.save(weights),
            },
        )


@torch.no_grad()
def _error(learner: EncoderLearner, seen: StatePairs, clean: StatePairs) -> float:
    """Returns the mean squared error of reconstructing clean states from those that are seen."""
    kind = learner.kind
    rebuilt = kind.decode(learner.weights, kind.encode(learner.weights, seen.now))
    target = clean.later if kind.decodes_later else clean.now
    return float((rebuilt - target).square().mean(dtype=torch.float64))
