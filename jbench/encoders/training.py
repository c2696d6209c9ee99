"""Training, evaluating and saving an encoder."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import safetensors.numpy
import torch
from numpy.typing import NDArray

from jbench.cores import one_thread
from jbench.encoders.kind import Fitted, Kind, Learned
from jbench.encoders.loop import CHECKPOINT, WeightArrays, check_kind, encoder_tables, learn
from jbench.encoders.pairs import state_pairs
from jbench.encoders.predictions import predictions
from jbench.encoders.reconstruction import error_rows
from jbench.encoders.registry import description, kind_provenance, make_kind, sentence_about
from jbench.encoders.saved import DESCRIPTION, WEIGHTS, SavedEncoder
from jbench.encoders.scaling import rescaling
from jbench.encoders.settings import EncoderSettings
from jbench.encoders.states import States
from jbench.errors import RequestError, WorkError
from jbench.representation_names import ENCODER_KINDS
from jbench.store import Record, Results
from jbench.store.code import check_code
from jbench.store.planned import Planned, planned
from jbench.store.provenance import device_provenance


def plan_encoder(settings: EncoderSettings, results: Results) -> Planned[EncoderSettings]:
    """Returns settings with the id of a recorded encoder of the same code, if there is one."""
    if settings.kind in ENCODER_KINDS:
        return Planned(settings, [])
    free = ("seed", "dataset", "latents", "options", "base", "named")
    return planned(settings, results.scan("encoder")[0], kind_provenance(settings.kind), free)


def train_encoder(
    settings: EncoderSettings,
    states: States,
    results: Results,
    progress: Callable[[int], None] = lambda epoch: None,
    *,
    device: torch.device = torch.device("cpu"),  # noqa: B008 - a constant
    commit_every: float = 15.0,
) -> Record:
    """Trains and saves an encoder, resumes its training, or returns the finished one.

    A resumed training ends with the same weights, bit for bit, as an uninterrupted one. Rescaled
    latents are those of the finished encoder without `rescale`, if the results contain it.

    Args:
        states: of the settings' dataset, task and seed; several encoders can share them.
        progress: called with the number of completed epochs; a fitted kind has one.
        commit_every: minimum seconds between checkpoints, which are written after an epoch.

    Raises:
        RequestError: if the kind looks further ahead than any episode lasts.
        ValueError: if the states are not those of the settings, or have another scale.
        WorkError: if another process trains it, the dataset is damaged, a method of its kind fails,
            or the training diverges.
    """
    kind = make_kind(settings.kind, settings.options)
    wanted = settings.dataset, settings.task, settings.seed, kind.scale
    if (states.dataset.id, states.task, states.seed, states.scale) != wanted:
        raise ValueError(f"these are not the states of {settings.id}")

    _check_horizon(kind, states)

    with results.locked("encoder", settings.id) as record:
        if record is not None and record.is_finished:
            return record
        if record is not None:
            check_code(record, kind_provenance(settings.kind))

        states.read(device)
        _check_pairs(kind, states)
        if settings.columns is not None:
            states = states.only(settings.columns)
        if isinstance(kind, Learned) and settings.kind not in ENCODER_KINDS:
            check_kind(kind, settings.kind, states, settings.latents)

        if record is None or CHECKPOINT not in record.roles():
            made_on = device_provenance(device) | kind_provenance(settings.kind)
            meaning = description(settings.kind)
            if meaning:
                made_on["description"] = meaning
            record = results.create("encoder", settings.id, settings.model_dump(), made_on)

        with one_thread():
            weights = _weights(
                settings,
                kind,
                states,
                results,
                record,
                progress=progress,
                commit_every=commit_every,
            )
            # An interrupted process may have committed the errors already.
            if not record.rows("encoder_errors"):
                rows = error_rows(kind, weights, settings.latents, states)
                rows["encoder_predictions"] = predictions(kind, weights, states)
                record.append(encoder_tables(record.id, rows))

        _finish(settings, kind, record, states, weights)

    return record


def counted_latents(name: str, options: Mapping[str, Any], states: States, latents: int) -> int:
    """Returns how many latents a fitted kind has that was asked for `latents`.

    The states have been read. Raises a WorkError if a method of the kind fails.
    """
    kind = make_kind(name, options)
    assert isinstance(kind, Fitted)
    with sentence_about(name, "fit or encode"):
        weights = _float32(kind.fit(states, latents))
        return int(np.shape(kind.encode(weights, np.zeros((1, states.size), np.float32)))[-1])


def _weights(
    settings: EncoderSettings,
    kind: Kind,
    states: States,
    results: Results,
    record: Record,
    *,
    progress: Callable[[int], None],
    commit_every: float,
) -> WeightArrays:
    """Returns the weights of an encoder after training, with those of its scale of latents."""
    # The encoder without `rescale`; it is this one, unfinished, if it has no such option.
    options = {name: value for name, value in settings.options.items() if name != "rescale"}
    other = settings.model_copy(update={"options": options})
    plain = None
    if not record.rows("encoder_epochs"):
        plain = results.find("encoder", other.id)

    if plain is not None and plain.is_finished:
        epochs = {"encoder_epochs": plain.read("encoder_epochs").to_pylist()}
        record.append(encoder_tables(record.id, epochs))
        weights: WeightArrays = safetensors.numpy.load(plain.read_file(WEIGHTS))
    elif isinstance(kind, Learned):
        weights = learn(
            kind,
            states,
            record,
            settings.latents,
            progress=progress,
            commit_every=commit_every,
        )
    else:
        weights = _fitted(settings, kind, states)
        progress(1)

    if kind.rescale is not None:
        blocks = (batch.now.cpu().numpy() for batch in state_pairs(states.learn(), 0))
        latents = (kind.encode(weights, block) for block in blocks)
        weights.update(_float32(rescaling(kind.rescale, latents)))

    try:
        with sentence_about(settings.kind, "encode or decode"):
            SavedEncoder(kind, weights, states.scaling, settings.latents, states.is_observed)
            _check_types(settings.kind, kind, weights, states)
    except ValueError as error:
        raise WorkError(f"The encoder {settings.id} can't be used: {error}.") from None

    return weights


def _check_types(name: str, kind: Kind, weights: WeightArrays, states: States) -> None:
    """Raises a WorkError if `encode` or `decode` make anything but tensors of tensors."""
    tensors = {key: torch.from_numpy(value).to(states.device) for key, value in weights.items()}
    scaled = next(state_pairs([states.sample], 0)).now[:2]
    latents = kind.encode(tensors, scaled)
    made = {"encode": latents}
    if isinstance(latents, torch.Tensor):
        made["decode"] = kind.decode(tensors, latents)

    for method, values in made.items():
        if not isinstance(values, torch.Tensor):
            raise WorkError(
                f"The kind of encoder {name} can't be used: {method} gets a torch.Tensor during "
                f"training and returns a {type(values).__module__}.{type(values).__name__}; use "
                "operations that both types have (docs/your-own-encoder.md)."
            )


def _fitted(settings: EncoderSettings, kind: Kind, states: States) -> WeightArrays:
    """Returns the weights of a kind without training loop, and of its decoder if it has none."""
    assert isinstance(kind, Fitted)
    with sentence_about(settings.kind, "fit"):
        weights = _float32(kind.fit(states, settings.latents))
    if kind.is_regressed:
        with sentence_about(settings.kind, "encode"):
            weights.update(_float32(kind.linear_decoder(weights, states)))
    return weights


def _check_horizon(kind: Kind, states: States) -> None:
    """Raises a RequestError if a kind looks beyond the end of an episode."""
    length = states.dataset.settings.episode_steps
    if kind.steps_ahead >= length:
        raise RequestError(
            f"horizon={kind.steps_ahead} is beyond the end of an episode of {states.task}, which "
            f"has {length} control steps; type a smaller one."
        )


def _check_pairs(kind: Kind, states: States) -> None:
    """Raises a RequestError if a kind looks beyond the end of all episodes of one side.

    Those that end early may all be shorter than the time limit, which `_check_horizon` knows.
    """
    if states.dataset.has_one_length:
        return

    ahead = kind.steps_ahead
    if not any(shard.pairs(ahead) for shard in states.learn()):
        episodes = "training episode"
    elif not states.sample.pairs(ahead):
        episodes = "held-out episode"
    else:
        return

    raise RequestError(
        f"horizon={ahead} is beyond the end of every {episodes} of {states.dataset.id}: "
        "type a smaller one, or collect more episodes."
    )


def _float32(weights: Mapping[str, NDArray[Any]]) -> WeightArrays:
    """Returns weights as they are saved."""
    return {name: np.ascontiguousarray(value, np.float32) for name, value in weights.items()}


def _finish(
    settings: EncoderSettings, kind: Kind, record: Record, states: States, weights: WeightArrays
) -> None:
    """Writes the weights, the description and the errors of an encoder, which is then finished."""
    description = {
        **{name: getattr(settings, name) for name in ("kind", "options", "task", "latents")},
        "features": states.labels,
        "minimum": states.scaling.minimum.tolist(),
        "maximum": states.scaling.maximum.tolist(),
    }
    if settings.columns is not None:
        description["is_observed"] = states.is_observed

    (totals,) = record.read("encoder_errors").to_pylist()
    epochs = record.read("encoder_epochs").to_pylist()
    predictions = record.read("encoder_predictions").to_pylist()
    names = ("test_mse", "test_explained", "pca_explained", "heuristic_explained")
    record.finish(
        {
            **{name: totals[name] for name in names},
            "effective_rank": _last_value(predictions, "effective_rank"),
            **kind.summary(weights),
            "wall_time": _last_value(epochs, "wall_time"),
            "device": states.device.type,
        },
        {
            DESCRIPTION: json.dumps(description, indent=1).encode(),
            WEIGHTS: safetensors.numpy.save(weights),
        },
    )


def _last_value(rows: Sequence[Mapping[str, Any]], column: str) -> Any:
    """Returns the value of a column in the last row; None without rows."""
    if not rows:
        return None
    return rows[-1][column]
