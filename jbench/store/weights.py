"""Which encoder a run was trained with, by the weights.

An id follows from the settings, so encoders that two processors have trained have one id and other
weights. The provenance of a run has a checksum of those that it was trained with; runs of older
versions have none.
"""

import json

from jbench.errors import RequestError, WorkError
from jbench.names import ENCODER_FILES
from jbench.settings.base import canonical_json
from jbench.store.database import Results
from jbench.store.files import sha256
from jbench.store.manifest import ID
from jbench.store.record import Record

ENCODER_WEIGHTS = "encoder_weights"
"""Key of a run's provenance: the checksum of its encoder's weights and of the scaling of inputs."""


def weights_checksum(encoder: Record) -> str | None:
    """Returns the checksum of the weights of an encoder, and of the extremes that it scales by.

    None if it is not finished, or its files are damaged.
    """
    weights, description = ENCODER_FILES
    if not encoder.is_finished:
        return None
    try:
        described = json.loads(encoder.read_file(description))
        numbers = {
            "weights": sha256(encoder.read_file(weights)),
            "minimum": described["minimum"],
            "maximum": described["maximum"],
        }
        return sha256(canonical_json(numbers).encode())
    except (WorkError, ValueError, LookupError, TypeError, RecursionError):
        return None


def encoder_weights(encoders: Results, id: str | None) -> dict[str, str]:
    """Returns what the provenance of a run says of its encoder; {} without an encoder."""
    encoder = encoders.find_readable("encoder", id)
    if encoder is None:
        return {}

    checksum = weights_checksum(encoder)
    if checksum is None:
        return {}
    return {ENCODER_WEIGHTS: checksum}


def has_other_encoder(run: Record, encoders: Results) -> bool:
    """Returns whether the encoder at hand has other weights than that of a run; unknown is no."""
    recorded: object = run.manifest.provenance.get(ENCODER_WEIGHTS)
    id: object = run.settings.get("encoder")
    if recorded is None or not isinstance(id, str) or not ID.fullmatch(id):
        return False
    now = encoder_weights(encoders, id).get(ENCODER_WEIGHTS)
    return now is not None and now != recorded


def check_encoder(run: Record, encoders: Results) -> None:
    """Raises a RequestError if the encoder at hand has other weights than that of a run."""
    if has_other_encoder(run, encoders):
        raise RequestError(
            f"The run {run.id} was trained with another encoder {run.settings['encoder']} than the "
            f"one in {encoders.name}, which has the same settings and other weights; copy the "
            "encoder of the run there, or name the results directory that the run comes from."
        )
