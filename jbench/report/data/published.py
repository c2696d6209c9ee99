"""The paper's learning curves."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import EPISODE_STEPS, FULL
from jbench.report.data.curves import QUANTILES

PUBLISHED = "published"  # source of the paper's curves
SEQUENCE, SEQUENCE_ROBOTS = "augmented SAC", 10
"""The authors' curve of SAC on augmented robots in sequence, with 1e6 control steps each."""

# Columns of quantiles in frames, and those that name a curve.
NAMES = {f"q{percent}": "median" if percent == 50 else f"q{percent}" for percent in QUANTILES}
CURVE = ["figure", "task", "algo", "representation"]


def read_published(table: pa.Table) -> pd.DataFrame:
    """Returns the curves of Figures 7, 8 and 9, and of SAC on ten augmented robots in sequence.

    Columns: figure (`Figure 9`, or `SEQUENCE`), task, algo, representation, steps (center of the
    window, as printed), q10, q25, median, q75, q90 (NaN if a figure lacks them), source, seeds.
    Figure 8 with a wider, estimated band is left out.
    """
    rows: pd.DataFrame = table.to_pandas(use_threads=False)
    rows = rows[rows["figure"] != "fig8-10-90"]
    index = [*CURVE, "control_steps"]
    wide = rows.set_index([*index, "quantile"])["episode_return"].unstack().reset_index()
    wide.columns = pd.Index([*CURVE, "steps", *(NAMES[f"q{q}"] for q in wide.columns[5:])])
    wide = wide[wide["median"].notna()].reindex(columns=[*CURVE, "steps", *NAMES.values()])
    sequence = wide["figure"] == "augmented-sac"
    figure = wide["figure"].str.replace("fig", "Figure ").where(~sequence, SEQUENCE)
    representation = wide["representation"].where(~sequence, FULL)
    seeds = np.where(figure == "Figure 7", 1, 10)
    wide = wide.assign(figure=figure, representation=representation, source=PUBLISHED, seeds=seeds)
    return wide.astype({"steps": float})


def best_median(
    published: pd.DataFrame, names: Sequence[str], control_steps: float, *, sequence: bool = False
) -> tuple[float, str] | None:
    """Returns the best published median at a control step, and the figure's name.

    Names are those of a task, an algorithm and a representation.

    It is interpolated at the center of a window, on the curve of the plain robot or of a sequence
    of augmented ones. A curve's ends have a tolerance of an episode, because the paper's windows
    are counted from the start of an episode and ours from its end.
    """
    named = (published[CURVE[1:]] == [*names]).all(axis=1)
    medians = []
    for figure, curve in published[named].groupby("figure"):
        steps, median = curve[["steps", "median"]].to_numpy().T
        within = steps[0] - EPISODE_STEPS <= control_steps <= steps[-1] + EPISODE_STEPS
        if within and sequence == (figure == SEQUENCE):
            medians.append((float(np.interp(control_steps, steps, median)), str(figure)))
    return max(medians, default=None)
