"""Encoders of one id with different weights, which agents of one curve may have."""

import json
from collections.abc import Iterator, Mapping

import pandas as pd

from jbench.store.weights import ENCODER_WEIGHTS


def recorded_weights(provenance: object) -> str | None:
    """Returns the checksum of the encoder of a run, of whose provenance this is the JSON."""
    if not isinstance(provenance, str) or ENCODER_WEIGHTS not in provenance:
        return None
    values = json.loads(provenance)
    checksum = values.get(ENCODER_WEIGHTS) if isinstance(values, Mapping) else None
    return checksum if isinstance(checksum, str) else None


def notes_on_weights(runs: pd.DataFrame) -> Iterator[str]:
    """Yields a note on each encoder id that stands for several encoders.

    Runs of older versions did not record which one they had; they count as none.

    Args:
        runs: of a configuration, with the columns seed, encoder and weights.
    """
    known = runs[runs["weights"].notna()].sort_values("seed")
    for id, same in known.groupby("encoder"):
        seeds = [
            "seed " + ", ".join(each.astype(str))
            for _, each in same.groupby("weights", sort=False)["seed"]
        ]
        if len(seeds) > 1:
            yield (
                f"{len(seeds)} encoders of different weights have the id {id}: "
                + " and ".join(f"that of {each}" for each in seeds)
            )
