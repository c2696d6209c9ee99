"""Several files of one training, such as of one that was resumed from a checkpoint."""

from collections.abc import Sequence

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.readers import Series


def in_order(parts: Sequence[Series], by: str = "control_steps") -> list[Series]:
    """Returns the files of a seed in the order of a column, however they were named."""
    return sorted(
        parts, key=lambda part: (*part.points[[by, "wall_time"]].iloc[0], part.file.sha256)
    )


def continued(parts: Sequence[Series]) -> list[pd.DataFrame]:
    """Returns the points of each file of a training, without those that a later file replaces.

    Raises a RequestError if files overlap of which none says that it resumes the training.
    """
    kept: list[pd.DataFrame] = []
    for place, part in enumerate(parts):
        kept = [points[points["control_steps"] < part.resumed_at] for points in kept]
        first = part.points["control_steps"].iloc[0]
        for earlier, points in zip(parts[:place], kept, strict=True):
            if len(points) and first <= points["control_steps"].iloc[-1]:
                raise RequestError(
                    f"{earlier.file.path} and {part.file.path} are both of seed {part.seed} and "
                    f"both have values at {first:,.0f} control steps: they are two trainings; "
                    "leave one of them out."
                )

        kept.append(part.points)

    return kept
