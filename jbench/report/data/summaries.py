"""Rows of all curves and cells, and notes on them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.data.cells import Cell, LearnedCurve
from jbench.report.data.curves import QUANTILES, final_returns, quantiles_across_seeds
from jbench.report.data.published import (
    PPO_ENVIRONMENTS,
    SEQUENCE_ROBOTS,
    PublishedCurve,
    best_median,
)
from jbench.report.data.returns import KINDS, TRAINING

_KEY = ("task", "algo", "representation", "variant", "source")
_RETURN = ("return_median", "return_q10", "return_q90", "return_steps")
_COLUMNS = [
    *_KEY,
    *("settings", "seeds", "diverged", "steps_min", "steps_max", "episodes_min", "episodes_max"),
    *(f"{kind.name}_{name}" for kind in KINDS.values() for name in _RETURN),
    *("published_median", "published_figure", "notes"),
]


def aggregate_curves(learned: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns the points of all curves, sorted by their cells' names and control steps.

    Columns: task, algo, representation, variant, source (ours, or another), returns (their kind:
    evaluation or training), order, window (episodes, or evaluations, averaged in this point: fewer
    at the ends of a run), control_steps (center of the window), seeds, and the return's quantiles
    q10, q25, q50, q75, q90.
    """
    ordered = sorted(learned, key=lambda item: (item.cell.key, item.cell.kind.name))
    parts = [
        pd.DataFrame(
            {
                **dict(zip(_KEY, cell.key, strict=True)),
                "returns": cell.kind.name,
                "order": curve.order,
                "window": curve.widths,
                "control_steps": curve.control_steps,
                "seeds": curve.seeds,
                **{f"q{percent}": curve.quantile(percent) for percent in QUANTILES},
            }
        )
        for cell, curve in ordered
    ]
    if parts:
        return pd.concat(parts, ignore_index=True)
    columns = (*_KEY, "returns", "order", "window", "control_steps", "seeds")
    return pd.DataFrame(columns=[*columns, *(f"q{percent}" for percent in QUANTILES)])


def summary_table(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], window: int
) -> pd.DataFrame:
    """Returns a row per cell: the final returns of its seeds, and the published median.

    Columns: task, algo, representation, variant, source (ours, or another), settings (those that
    distinguish a variant), seeds, diverged (number of seeds), steps_min and steps_max (control
    steps of training), episodes_min, episodes_max, and for evaluation and for training returns:
    …_return_median, …_return_q10, …_return_q90 (of the final returns across seeds) and
    …_return_steps (control steps at which they are measured, median over seeds);
    published_median and published_figure (the paper's best at training_return_steps; missing if
    its curves don't reach it; for a sequence of robots, of the paper's sequence), notes.

    Args:
        learned: the curves of both kinds of return.
        window: requested number of episodes in a moving average; notes name smaller ones.
    """
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    trained = {item.cell.key for item in learned if item.cell.kind is TRAINING}
    for item in learned:
        row = rows.setdefault(item.cell.key, {"notes": []})
        row |= _final(item.cell)
        row["notes"] += cell_notes(item, published, window)
        if item.cell.kind is TRAINING or item.cell.key not in trained:
            row |= _table_row(item.cell, published)
    return pd.DataFrame(
        [{**row, "notes": "; ".join(row["notes"])} for row in rows.values()], None, _COLUMNS
    )


def published_beside(cell: Cell, published: Sequence[PublishedCurve]) -> tuple[float, str] | None:
    """Returns the paper's best median at the end of a cell of training returns, and its figure."""
    if cell.kind is not TRAINING:
        return None
    names = cell.task, cell.algo, cell.representation
    steps = _final(cell)["training_return_steps"]
    return best_median(published, *names, steps, sequence=cell.robots > 1)


def _final(cell: Cell) -> dict[str, float]:
    """Returns the columns of the final returns of a cell."""
    returns, centers = final_returns(
        cell.returns, cell.control_steps, cell.lengths, cell.kind.final_points
    )
    q10, _, median, _, q90 = quantiles_across_seeds(returns[:, None])[:, 0]
    values = median, q10, q90, float(np.median(centers))
    return {f"{cell.kind.name}_{name}": x for name, x in zip(_RETURN, values, strict=True)}


def cell_notes(item: LearnedCurve, published: Sequence[PublishedCurve], window: int) -> list[str]:
    """Returns notes on a cell's curve, a clause each."""
    cell, curve = item
    notes = list(cell.notes)
    if cell.kind is not TRAINING:
        return notes
    if curve.window != window and cell.robots <= 1:
        notes.append(
            f"window of {curve.window} instead of {window} episodes, as the longest run has "
            f"{cell.lengths.max()}"
        )
    short = int((cell.lengths < curve.window).sum())
    if short:
        notes.append(f"{short} of {len(cell.seeds)} seeds have fewer episodes than the window")
    compared = {(theirs.task, theirs.algo, theirs.representation) for theirs in published}
    if (cell.task, cell.algo, cell.representation) not in compared:
        return notes
    if cell.algo == "ppo":
        notes.append(
            "published steps are taken as printed, but are probably those of one of "
            f"{PPO_ENVIRONMENTS} environments"
        )
    if cell.robots == 1:
        notes.append("trained on an augmented robot, but the published curves are of the plain one")
    if cell.robots > 1:
        notes.append(
            f"trained on {cell.robots} augmented robots in sequence: the published curve, if there "
            f"is one, is of {SEQUENCE_ROBOTS} other robots, 1000000 control steps each"
        )
    return notes


def _table_row(cell: Cell, published: Sequence[PublishedCurve]) -> dict[str, Any]:
    median, figure = published_beside(cell, published) or (math.nan, None)
    steps_min, steps_max = cell.trained
    return {
        **dict(zip(_KEY, cell.key, strict=True)),
        "settings": cell.label,
        "seeds": len(cell.seeds),
        "diverged": cell.diverged_count,
        "steps_min": steps_min,
        "steps_max": steps_max,
        "episodes_min": int(cell.lengths.min()),
        "episodes_max": int(cell.lengths.max()),
        "published_median": median,
        "published_figure": figure,
    }


def sentences(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], window: int
) -> list[str]:
    """Returns the notes on all cells, a sentence each; equal notes are one sentence."""
    named: dict[str, list[str]] = {}
    for item in learned:
        for note in cell_notes(item, published, window):
            named.setdefault(note, []).append(item.cell.name)
    return [f"{_of_cells(names)}: {note}." for note, names in named.items()]


def _of_cells(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} cells, such as {names[0]}"
