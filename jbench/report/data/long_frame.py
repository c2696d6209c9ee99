"""Frames with a row per point of several curves or paths."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

Part = tuple[Mapping[str, Any], Mapping[str, Any]]
"""Of a frame: names of its rows, and arrays (rows,) by column."""


def long_frame(parts: Iterable[Part], columns: Sequence[str]) -> pd.DataFrame:
    """Returns the arrays of all parts below each other; a row has the names of its part."""
    pairs = [(names, arrays) for names, arrays in parts if len(next(iter(arrays.values())))]
    if not pairs:
        return pd.DataFrame(columns=[*columns])

    names = pd.DataFrame([names for names, _ in pairs])
    sizes = [len(next(iter(arrays.values()))) for _, arrays in pairs]
    # Texts are repeated once for all parts, which is much faster than a frame for each.
    rows = names.loc[names.index.repeat(sizes)].reset_index(drop=True)
    joined = {name: np.concatenate([arrays[name] for _, arrays in pairs]) for name in pairs[0][1]}
    return rows.assign(**joined).reindex(columns=[*columns])
