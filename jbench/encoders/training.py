"""Training, evaluating and saving an encoder."""

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import safetensors.numpy
import torch
from numpy.typing import NDArray

from jbench.cores import one_thread
from jbench.encoders.evaluation import error_tables, evaluate_encoder
from jbench.encoders.kind import ClosedForm, Fitted, Kind, Learned
from jbench.encoders.kind_check import check_kind
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.pairs import StatePairs
from jbench.encoders.predictions import Probe, probe
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
            check_kind(kind, settings.kind, states, settings.latents, device)
        if record is None or CHECKPOINT not in record.roles():
            made_on = device_provenance(device) | code_provenance(settings.kind)
            record = results.create("encoder", settings.id, settings.model_dump(), made_on)
        with one_thread():
            weights = _trained_without_rescale(settings, record, results)
            if weights is None:
                weights = _weights(kind, settings, states, record, device, progress, commit_every)
            if kind.rescale is not None:
                weights |= rescaling(kind.rescale, _latents(kind, weights, states))
            try:
                SavedEncoder(kind, weights, states.scaling, settings.latents)
            except ValueError as error:
                raise WorkError(f"The encoder {settings.id} can't be used: {error}.") from None
            # An interrupted process may have committed the errors already.
            if not record.rows("encoder_errors"):
                errors = evaluate_encoder(kind, weights, settings.latents, states)
                predictions = _predictions(record, probe(kind, weights, states))
                record.append(error_tables(record.id, settings.task, errors) | predictions)
        _finish(record, settings, kind, states, weights, device)
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


def _weights(
    kind: Kind,
    settings: EncoderSettings,
    states: States,
    record: Record,
    device: torch.device,
    progress: Callable[[int], None],
    commit_every: float,
) -> WeightArrays:
    """Returns the trained weights as numpy arrays in float32."""
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
    learner = EncoderLearner(
        kind,
        states.size,
        settings.latents,
        settings.seed,
        device,
        constants,
        action_size=states.action_size,
    )
    if CHECKPOINT in record.roles():
        learner.restore(record.read_file(CHECKPOINT))
    _learn(learner, states, record, progress, commit_every)
    return {name: value.detach().cpu().numpy() for name, value in learner.weights.items()}


def _learn(
    learner: EncoderLearner,
    states: States,
    record: Record,
    progress: Callable[[int], None],
    commit_every: float,
) -> None:
    """Trains the remaining epochs and commits their rows with checkpoints."""
    done = record.read("encoder_epochs").to_pylist()
    before = done[-1]["wall_time"] if done else 0.0
    measure = _error_measure(learner, states)
    rows: list[dict[str, Any]] = []
    start, committed = time.perf_counter(), -math.inf
    progress(len(done))
    for epoch in range(len(done) + 1, learner.kind.epochs + 1):
        loss = learner.epoch(states)
        if not math.isfinite(loss):
            raise WorkError(
                f"The training of {record.id} diverged: the loss of epoch {epoch} is {loss}; type "
                "a smaller --learning-rate."
            )
        row = {"encoder": record.id, "epoch": epoch, "train_loss": loss, **measure()}
        now = time.perf_counter()
        rows.append({**row, "wall_time": before + now - start})
        if now - committed >= commit_every or epoch == learner.kind.epochs:
            table = pa.Table.from_pylist(rows, encoder_schema.ENCODER_EPOCHS)
            record.append({"encoder_epochs": table}, {CHECKPOINT: learner.to_bytes()})
            rows, committed = [], now
        progress(epoch)


def _error_measure(
    learner: EncoderLearner, states: States
) -> Callable[[], dict[str, float | None]]:
    """Returns a function that measures the errors on fixed states with fixed corruption."""
    kind, ahead = learner.kind, learner.kind.steps_ahead
    numbers = torch.arange(states.sample.pairs(ahead), device=learner.device)
    clean = states.sample.take(numbers, ahead, kind.uses_actions)
    # A separate generator: measuring an error must not change the training.
    corrupted = kind.prepare(clean, learner.latents, torch.Generator().manual_seed(0))

    @torch.no_grad()
    def error(batch: StatePairs) -> float:
        rebuilt = kind.decode(learner.weights, kind.encode(learner.weights, batch.now))
        target = clean.later if kind.decodes_later else clean.now
        return float((rebuilt - target).square().mean(dtype=torch.float64))

    def measure() -> dict[str, float | None]:
        same = corrupted.now is clean.now
        return {
            "test_mse": error(clean),
            "test_denoising_mse": None if same else error(corrupted),
        }

    return measure


def _predictions(record: Record, probe: Probe) -> dict[str, pa.Table]:
    """Returns a row per target of the probe."""
    shared = {
        "encoder": record.id,
        "effective_rank": probe.effective_rank,
        "learned_rows": probe.learned_rows,
        "test_rows": probe.test_rows,
    }
    rows = [
        {"target": target, **prediction._asdict(), **shared}
        for target, prediction in probe.predictions.items()
    ]
    return {"encoder_predictions": pa.Table.from_pylist(rows, encoder_schema.ENCODER_PREDICTIONS)}


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
        "features": find_task(settings.task).labels,
        "minimum": states.scaling.minimum.tolist(),
        "maximum": states.scaling.maximum.tolist(),
    }
    (totals,) = record.read("encoder_errors").to_pylist()
    epochs = record.read("encoder_epochs").to_pylist()
    predictions = record.read("encoder_predictions").to_pylist()
    names = ("test_mse", "test_explained", "pca_explained", "heuristic_explained")
    record.finish(
        {
            **{name: totals[name] for name in names},
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
