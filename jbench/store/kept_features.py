"""The share of each feature that an encoder keeps: the column `kept` of `encoder_features`.

An encoder of one layer sees a state only through some directions, the rows of its weights. The
share of a feature is the squared length of its unit vector's projection on the span of these
directions. It is 1 if the feature can be reconstructed, and 0 if it is lost. The sum over all
features is the number of independent directions. Shares are computed from the weights when rows
are read, so encoders of every age have them.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
import safetensors
import safetensors.numpy
from numpy.typing import NDArray

from jbench.names import ENCODER_FILES
from jbench.store.encoder_tables import KEPT
from jbench.store.files import DamagedError
from jbench.store.record import Record

_WEIGHTS = ENCODER_FILES[0]

_DIRECTIONS = {
    "dae": "encoder.weight",
    "dae-yaw": "encoder.weight",
    "ae": "encoder.weight",
    "ddae": "encoder.weight",
    "forward": "encoder.weight",
    "inverse": "encoder.weight",
    "contrastive": "encoder.weight",
    "pca": "components",
    "dmd": "directions",
    "random": "projection",
    "random-features": "directions",
}
"""The kinds of one layer, and the weights (latents, size) of which the rows are directions."""

_IDENTITIES = ("scaled", "raw")  # each latent is a feature
_SMALLEST = 1e-6  # singular values relative to the largest; smaller ones are no directions


def with_kept(record: Record, rows: pa.Table) -> pa.Table:
    """Returns rows of `encoder_features` of an encoder with the column `kept`.

    It is null for kinds of more than one layer, and for a record that lists no weights: before an
    encoder is finished, or if its folder lacks a file that it may lack. Raises a RecordError if the
    weights are damaged.
    """
    kind = str(record.settings.get("kind"))
    shares: NDArray[np.float64] | None = None
    has_one_layer = kind in (*_DIRECTIONS, *_IDENTITIES)
    has_weights = any(entry.name == _WEIGHTS for entry in record.manifest.files)
    if has_one_layer and has_weights and len(rows):
        content = record.read_file(_WEIGHTS)
        try:
            weights = safetensors.numpy.load(content)
            shares = kept(kind, weights, rows["feature"].to_pylist())
        except (safetensors.SafetensorError, LookupError, ValueError) as error:
            problem = f"is damaged ({error})"
            raise DamagedError(record.path / _WEIGHTS, problem, record.advice) from None

    column = pa.nulls(len(rows), pa.float64()) if shares is None else pa.array(shares)
    return rows.append_column(pa.field(KEPT, pa.float64()), column)


def kept(
    kind: str, weights: Mapping[str, NDArray[np.floating]], features: Sequence[str]
) -> NDArray[np.float64] | None:
    """Returns the share (size,) of each feature that an encoder keeps.

    Args:
        kind: name of the kind.
        weights: of the encoder, by name.
        features: names of the features that it encodes.

    Returns:
        The shares; None for a kind that is more than one layer.

    Raises:
        LookupError: if the weights of the directions are missing.
        ValueError: if they have another size, or are not finite.
    """
    if kind in _IDENTITIES:
        return np.ones(len(features))
    if kind not in _DIRECTIONS:
        return None

    directions = weights[_DIRECTIONS[kind]]
    if directions.ndim != 2 or directions.shape[1] != len(features):
        raise ValueError("weights of another size")
    if not np.isfinite(directions).all():
        raise ValueError("weights that are not finite")
    if kind == "dae-yaw":  # whose last latent is this feature itself
        directions = np.vstack([directions, np.equal(features, "velocity_angular_z")])

    return kept_by(directions)


def kept_by(directions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns the share (size,) of each feature in the span of directions (latents, size)."""
    vectors, values, _ = np.linalg.svd(directions.T.astype(np.float64), full_matrices=False)
    basis = vectors[:, values > _SMALLEST * values.max(initial=0)]
    shares: NDArray[np.float64] = np.square(basis).sum(axis=1)
    return shares
