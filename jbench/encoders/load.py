"""Finished encoders of results, and what their records say about them."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from jbench.encoders.registry import make_kind, present_code
from jbench.encoders.saved import DESCRIPTION, WEIGHTS, Encoder, SavedEncoder
from jbench.encoders.scaling import Scaling
from jbench.encoders.settings import autoencoder_options
from jbench.errors import RequestError, WorkError
from jbench.representation_names import ENCODER_KINDS, kind_in
from jbench.store import Record, Results
from jbench.store.code import ChangedCodeError, check_code
from jbench.store.provenance import shell_command
from jbench.store.shipped import results_to_read
from jbench.typed_values import closest, question
from jbench.wording import with_results


class LoadedEncoder(NamedTuple):
    """A finished encoder and what its record says about it.

    Attributes:
        encoder: maps observations to latents.
        description: its `kind`, `options`, `task` and number of `latents`; names of the `features`
            that it encodes, and the `minimum` and `maximum` that are scaled to -1 and 1.
    """

    encoder: Encoder
    description: dict[str, Any]


def load_encoder(
    results: Results | Path | str,
    id: str,
    accept_changed: bool = False,
    task: str | None = None,
) -> LoadedEncoder:
    """Returns a finished encoder and its description.

    If there is none, the error lists the encoders of a task, or all of them for None.

    Raises:
        RequestError: if the encoder does not exist or is unfinished, or the code of its kind has
            changed, unless that is accepted.
        WorkError: if its files are damaged or invalid.
    """
    results = results_to_read(results)
    record = results.find("encoder", id)
    if record is None:
        raise _no_encoder(results, id, task)

    if not record.is_finished:
        command = shell_command(record.manifest.provenance)
        raise RequestError(f"The encoder {id} is unfinished; repeat `{command}` to finish it.")

    try:
        return _read(record, accept_changed)
    except ChangedCodeError:
        raise
    except (SafetensorError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise WorkError(f"The encoder {id} can't be read ({error}); train it again.") from None


def load_run_encoder(
    id: str | None, results: Results, accept_changed: bool = False
) -> Encoder | None:
    """Returns the encoder of a run, or None for the full observation; see `load_encoder`."""
    if id is None:
        return None
    return load_encoder(results, id, accept_changed).encoder


def _no_encoder(results: Results, id: str, task: str | None) -> RequestError:
    """Returns the error for an encoder that does not exist: those that do, or how to make one."""
    ids = [
        record.id
        for record in results.scan("encoder")[0]
        if record.is_finished and task in (None, record.settings.get("task"))
    ]
    if ids:
        choices = f"there are {', '.join(ids)}"
    else:
        of_task = "" if task is None else autoencoder_options(task)
        command = with_results(f"jbench train-dae{of_task}", results.name)
        choices = f"there is none yet: run {command}, or jbench train-encoder for another kind"

    typed = kind_in(id)
    close = closest(typed, [*ENCODER_KINDS])
    if close != typed and "/" not in id:
        choices = f"{question(close)}{choices}"

    return RequestError(
        f"No encoder {id} in {results.name}; {choices}. A kind with a number of latents, "
        "such as dae12, selects the newest one."
    )


def _read(record: Record, accept_changed: bool) -> LoadedEncoder:
    """Returns the encoder of a finished record; raises errors of any type for damaged files."""
    description = json.loads(record.read_file(DESCRIPTION))
    arrays = safetensors.numpy.load(record.read_file(WEIGHTS))

    size = len(description["features"])
    scaling = Scaling(
        minimum=np.array(description["minimum"], np.float32),
        maximum=np.array(description["maximum"], np.float32),
    )
    if scaling.minimum.shape != (size,) or scaling.maximum.shape != (size,):
        raise ValueError("a scaling of another size")

    # Version 1 did not save options, which affected only the training.
    kind = make_kind(description["kind"], description.get("options", {}))
    if not accept_changed:
        check_code(record, present_code(record))

    encoder = SavedEncoder(
        kind,
        weights={name: np.asarray(value, np.float32) for name, value in arrays.items()},
        scaling=scaling,
        latents=description["latents"],
        is_observed=description.get("is_observed"),
    )
    return LoadedEncoder(encoder, description)
