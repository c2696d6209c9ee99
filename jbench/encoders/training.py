"""From a dataset to a kept encoder with its errors."""

import json
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import safetensors.numpy
import torch
from numpy.typing import NDArray

from jbench.encoders.evaluation import Errors, judge
from jbench.encoders.kind import Batch, ClosedForm, Fitted, Kind, Learned
from jbench.encoders.loop import Learner, one_thread
from jbench.encoders.predictions import Probe, probe
from jbench.encoders.registry import make_kind
from jbench.encoders.saved import DESCRIPTION, WEIGHTS
from jbench.encoders.settings import EncoderSettings
from jbench.encoders.states import States
from jbench.errors import WorkError
from jbench.store import Record, Results, schema
from jbench.store.provenance import device_provenance
from jbench.tasks.features import feature_labels

CHECKPOINT = "checkpoint.safetensors"

_COMMIT_EVERY = 15.0  # s: what a kill can cost, beside the epoch under way

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
    """Trains and keeps an encoder, or continues one, or finds it finished.

    A training that was killed ends in the same weights, bit for bit, as one that was not.

    Args:
        settings: of the encoder.
        states: of the settings' dataset, task and seed; read once for all encoders of them.
        results: where the encoder goes.
        progress: called with the number of epochs done; a closed form has one.
        device: to compute on.
        commit_every: seconds between checkpoints, each at the end of an epoch.

    Raises:
        ValueError: if the states are not those of the settings.
        WorkError: if another process trains it, the dataset is damaged, or the training diverges.
    """
    if (states.dataset.id, states.task, states.seed) != (
        *(settings.dataset, settings.task, settings.seed),
    ):
        raise ValueError(f"these are not the states of {settings.id}")
    with results.hold("encoder", settings.id) as found:
        if found is not None and found.status == "finished":
            return found
        kind = make_kind(settings.kind, settings.options)
        states.read(device)
        if found is None or not found.has_checkpoint(CHECKPOINT):
            made_on = device_provenance(device)
            found = results.create("encoder", settings.id, settings.model_dump(), made_on)
        with one_thread():
            weights = _weights(kind, settings, states, found, device, progress, commit_every)
            # They are there if a kill came after them, in a commit of their own.
            if not found.rows("encoder_errors"):
                errors = judge(kind, weights, settings.latents, states)
                probed = probe(kind, weights, states)
                found.append(_tables(found, settings, errors) | _predictions(found, probed))
        _finish(found, settings, kind, states, weights, device)
    return found


def _weights(
    kind: Kind,
    settings: EncoderSettings,
    states: States,
    record: Record,
    device: torch.device,
    progress: Callable[[int], None],
    commit_every: float,
) -> WeightArrays:
    """Returns the weights of an encoder, of numpy in float32."""
    if isinstance(kind, (ClosedForm, Fitted)):
        fitted = (
            kind.fit(states, settings.latents)
            if isinstance(kind, Fitted)
            else kind.fit(states.learned, settings.latents, settings.seed)
        )
        progress(1)
        return {name: np.ascontiguousarray(v, np.float32) for name, v in fitted.items()}
    assert isinstance(kind, Learned)
    constants = kind.constants(states)
    learner = Learner(kind, states.size, settings.latents, settings.seed, device, constants)
    if record.has_checkpoint(CHECKPOINT):
        learner.restore(record.read_file(CHECKPOINT))
    _learn(learner, states, record, progress, commit_every)
    return {name: value.detach().cpu().numpy() for name, value in learner.weights.items()}


def _learn(
    learner: Learner,
    states: States,
    record: Record,
    progress: Callable[[int], None],
    commit_every: float,
) -> None:
    """Goes through the epochs that are left, committing their rows with a checkpoint."""
    done = record.read("encoder_epochs", schema.ENCODER_EPOCHS).to_pylist()
    before = done[-1]["wall_time"] if done else 0.0
    tell = _teller(learner, states)
    rows: list[dict[str, Any]] = []
    began, committed = time.perf_counter(), -math.inf
    progress(len(done))
    for epoch in range(len(done) + 1, learner.kind.epochs + 1):
        loss = learner.epoch(states)
        if not math.isfinite(loss):
            raise WorkError(
                f"The training of {record.id} diverged: the loss of epoch {epoch} is {loss}; type "
                "a smaller --learning-rate."
            )
        row = {"encoder": record.id, "epoch": epoch, "train_loss": loss, **tell()}
        now = time.perf_counter()
        rows.append({**row, "wall_time": before + now - began})
        if now - committed >= commit_every or epoch == learner.kind.epochs:
            table = pa.Table.from_pylist(rows, schema.ENCODER_EPOCHS)
            record.append({"encoder_epochs": table}, {CHECKPOINT: learner.to_bytes()})
            rows, committed = [], now
        progress(epoch)


def _teller(learner: Learner, states: States) -> Callable[[], dict[str, float | None]]:
    """Returns a function that measures the errors, always on the same states and corruption."""
    kind, ahead = learner.kind, learner.kind.steps_ahead
    numbers = torch.arange(states.sample.pairs(ahead), device=learner.device)
    clean = states.sample.take(numbers, ahead, kind.uses_actions)
    # A separate generator: measuring an error must not change the training.
    corrupted = kind.prepare(clean, learner.latents, torch.Generator().manual_seed(0))

    @torch.no_grad()
    def error(batch: Batch) -> float:
        rebuilt = kind.decode(learner.weights, kind.encode(learner.weights, batch.now))
        wanted = clean.later if kind.decodes_later else clean.now
        return float((rebuilt - wanted).square().mean(dtype=torch.float64))

    def tell() -> dict[str, float | None]:
        same = corrupted.now is clean.now
        return {
            "test_mse": error(clean),
            "test_denoising_mse": None if same else error(corrupted),
        }

    return tell


def _tables(
    record: Record, settings: EncoderSettings, errors: Mapping[str, Errors]
) -> dict[str, pa.Table]:
    """Returns the rows of an encoder's errors: of each feature, and of all together."""
    test, heuristic = errors["test"], errors["heuristic"]
    columns = {
        "test_mse": test.mse,
        "test_variance": test.variance,
        "pca_mse": test.pca,
        "random_mse": test.random,
        "heuristic_mse": heuristic.mse,
        "heuristic_variance": heuristic.variance,
        "pca_heuristic_mse": heuristic.pca,
        "random_heuristic_mse": heuristic.random,
    }
    labels = feature_labels(settings.task)
    features = {
        "encoder": [record.id] * len(labels),
        "index": range(len(labels)),
        "feature": labels,
        **columns,
    }
    totals = {
        "encoder": record.id,
        "test_states": test.states,
        "heuristic_states": heuristic.states,
        **{name: float(values.mean()) for name, values in columns.items()},
        "test_explained": test.explained(test.mse),
        "pca_explained": test.explained(test.pca),
        "random_explained": test.explained(test.random),
        "heuristic_explained": heuristic.explained(heuristic.mse),
        "pca_heuristic_explained": heuristic.explained(heuristic.pca),
        "random_heuristic_explained": heuristic.explained(heuristic.random),
    }
    return {
        "encoder_features": pa.table(features, schema=schema.ENCODER_FEATURES),
        "encoder_errors": pa.Table.from_pylist([totals], schema.ENCODER_ERRORS),
    }


def _predictions(record: Record, probed: Probe) -> dict[str, pa.Table]:
    """Returns a row for each number that is predicted from the latents."""
    shared = {
        "encoder": record.id,
        "effective_rank": probed.effective_rank,
        "learned_rows": probed.learned_rows,
        "test_rows": probed.test_rows,
    }
    rows = [{"target": target, "r2": r2, **shared} for target, r2 in probed.r2.items()]
    return {"encoder_predictions": pa.Table.from_pylist(rows, schema.ENCODER_PREDICTIONS)}


def _finish(
    record: Record,
    settings: EncoderSettings,
    kind: Kind,
    states: States,
    weights: WeightArrays,
    device: torch.device,
) -> None:
    """Commits the weights and the description of a trained encoder."""
    description = {
        "kind": settings.kind,
        "options": settings.options,
        "task": settings.task,
        "latents": settings.latents,
        "features": feature_labels(settings.task),
        "minimum": states.scaling.minimum.tolist(),
        "maximum": states.scaling.maximum.tolist(),
    }
    (totals,) = record.read("encoder_errors", schema.ENCODER_ERRORS).to_pylist()
    epochs = record.read("encoder_epochs", schema.ENCODER_EPOCHS).to_pylist()
    predictions = record.read("encoder_predictions", schema.ENCODER_PREDICTIONS).to_pylist()
    told = ("test_mse", "test_explained", "pca_explained", "heuristic_explained")
    record.finish(
        {
            **{name: totals[name] for name in told},
            "effective_rank": predictions[0]["effective_rank"] if predictions else None,
            **kind.summary(weights),
            "wall_time": epochs[-1]["wall_time"] if epochs else None,
            "device": device.type,
        },
        {
            DESCRIPTION: json.dumps(description, indent=1).encode(),
            WEIGHTS: safetensors.numpy.save(weights),
        },
    )
