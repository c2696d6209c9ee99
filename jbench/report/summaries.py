"""The rows of all curves and cells, and what a reader should know of them."""

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.cells import Cell
from jbench.report.curves import QUANTILES, final_returns, quantiles_across_seeds
from jbench.report.drawing import LearnedCurve
from jbench.report.published import (
    PPO_ENVIRONMENTS,
    SEQUENCE_ROBOTS,
    PublishedCurve,
    best_median,
)

_KEY = ("task", "algo", "representation", "variant", "source")
_COLUMNS = [
    *_KEY,
    *("settings", "seeds", "episodes_min", "episodes_max"),
    *("final_return_median", "final_return_q10", "final_return_q90", "control_steps"),
    *("published_median", "published_figure", "notes"),
]


def aggregate_curves(learned: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns the points of all curves, sorted by their cells' names and control steps.

    Columns: task, algo, representation, variant, source (ours, or another), order, window
    (episodes), control_steps (centre of the window), seeds, and the episode return's quantiles q10,
    q25, q50, q75, q90.
    """
    parts = [
        pd.DataFrame(
            {
                **{name: getattr(cell, name) for name in _KEY},
                "order": curve.order,
                "window": curve.window,
                "control_steps": curve.control_steps,
                "seeds": curve.seeds,
                **{f"q{percent}": curve.quantile(percent) for percent in QUANTILES},
            }
        )
        for cell, curve in sorted(learned, key=lambda item: [getattr(item.cell, n) for n in _KEY])
    ]
    columns = ["order", "window", "control_steps", "seeds", *(f"q{p}" for p in QUANTILES)]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=[*_KEY, *columns])


def summary_table(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], window: int
) -> pd.DataFrame:
    """Returns a row for each cell: what its seeds came to, beside what the paper's did.

    Columns: task, algo, representation, variant, source (ours, or another), settings
    (those that set a variant apart), seeds, episodes_min, episodes_max, final_return_median,
    final_return_q10, final_return_q90 (across seeds; a final return is the mean of a run's last 100
    episodes or last quarter), control_steps (centre of those episodes, the seeds' median),
    published_median and published_figure (best of the paper there; missing where its curves don't
    reach; on robots in turn where ours is), notes.
    """
    return pd.DataFrame([_table_row(item, published, window) for item in learned], None, _COLUMNS)


def cell_notes(item: LearnedCurve, published: Sequence[PublishedCurve], window: int) -> list[str]:
    """Returns what a reader of a cell's curve should know, a clause each."""
    cell, curve = item
    notes = list(cell.notes)
    if curve.window != window:
        notes.append(
            f"window of {curve.window} instead of {window} episodes, as the longest run has "
            f"{cell.lengths.max()}"
        )
    short = int((cell.lengths < curve.window).sum())
    if short:
        notes.append(f"{short} of {len(cell.seeds)} seeds have fewer episodes than the window")
    compared = {(theirs.task, theirs.algo, theirs.representation) for theirs in published}
    if cell.algo == "ppo" and (cell.task, cell.algo, cell.representation) in compared:
        notes.append(
            "published steps are taken as printed, but are probably those of one of "
            f"{PPO_ENVIRONMENTS} environments"
        )
    return notes + _robot_notes(cell, compared)


def _robot_notes(cell: Cell, compared: Collection[tuple[str, str, str]]) -> list[str]:
    """Says how a cell of augmented robots relates to what was published for its like."""
    if not cell.robots or (cell.task, cell.algo, cell.representation) not in compared:
        return []
    if cell.robots == 1:
        return ["learned on an augmented robot, but the published curves are of the plain one"]
    return [
        f"learned on {cell.robots} augmented robots in turn: what is published beside it, if "
        f"anything, is of {SEQUENCE_ROBOTS} other ones, 1000000 control steps each"
    ]


def _table_row(
    item: LearnedCurve, published: Sequence[PublishedCurve], window: int
) -> dict[str, Any]:
    cell = item.cell
    returns, centres = final_returns(cell.returns, cell.control_steps, cell.lengths)
    q10, _, median, _, q90 = quantiles_across_seeds(returns[:, None])[:, 0]
    control_steps = float(np.median(centres))
    best = best_median(
        published,
        cell.task,
        cell.algo,
        cell.representation,
        control_steps,
        sequence=cell.robots > 1,
    )
    return {
        **{name: getattr(cell, name) for name in _KEY},
        "settings": cell.label,
        "seeds": len(cell.seeds),
        "episodes_min": int(cell.lengths.min()),
        "episodes_max": int(cell.lengths.max()),
        "final_return_median": median,
        "final_return_q10": q10,
        "final_return_q90": q90,
        "control_steps": control_steps,
        "published_median": best[0] if best else math.nan,
        "published_figure": best[1] if best else None,
        "notes": "; ".join(cell_notes(item, published, window)),
    }


def sentences(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], window: int
) -> list[str]:
    """Returns the notes on all cells, a sentence each."""
    return [
        f"{item.cell.name}: {note}."
        for item in learned
        for note in cell_notes(item, published, window)
    ]
