"""Measurements of encoders, and the figure of errors against the number of latents."""

import json
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import ENCODER_KINDS, FULL, TASKS
from jbench.report.data.cells import in_order
from jbench.report.data.curves import FloatArray
from jbench.report.figure import Axis, Dash, Figure, Panel, ReferenceLine, Series, Style, padded
from jbench.report.figures.curve_series import KEY_COLOR
from jbench.settings.alike import ENCODER_VARIANT
from jbench.settings.base import settings_hash
from jbench.settings.variants import variant_labels

# No kind has the color of an algorithm (`learning_curves.ALGORITHM_COLORS`).
_LOOKS = {
    "dae": ("#d55e00", "o"),
    "ae": ("#56b4e9", "s"),
    "ddae": ("#4b3fb5", "D"),
    "vae": ("#7f9a00", "^"),
    "lld-vae": ("#8c3b00", "v"),
    "pca": ("#000000", "P"),
    "random": ("#888888", "X"),
    "scaled": ("#b8a200", "h"),
    "planar": ("#7a3e9d", "*"),
    "planar-mirror": ("#b04a8f", "$M$"),
    "forward": ("#c00000", "<"),
    "dmd": ("#6b4c2a", ">"),
    "contrastive": ("#005f3c", "d"),
    "random-features": ("#8080b8", "H"),
    "ofe": ("#d4a017", "8"),
}
_FULL = ("#595959", "o")
_OTHER = ("#00868b", "p")
_FLOOR = 1e-3
"""Smaller fractions of unexplained variance are drawn at this value."""

_DATA: dict[str, Dash] = {"test": "-", "heuristic": "--"}
_LABELS = {"test": "held-out episodes of the dataset", "heuristic": "episodes of the heuristic"}
_WIDTH = 1.5

_FRACTIONS = ("test", "pca", "random", "heuristic", "pca_heuristic")
PREDICTED = {
    "yaw_rate": "yaw rate",
    "forward_speed": "forward speed",
    "tilt_rate": "tilt rate",
    "reward": "reward",
}
"""Names of the predicted quantities of the next control step, by column."""


def look_of(kind: str) -> tuple[str, str]:
    """Returns the color and marker of a kind of representation, which all figures share."""
    return _FULL if kind == FULL else _LOOKS.get(kind, _OTHER)


def encoder_table(tables: dict[str, pa.Table], task: str | None = None) -> pd.DataFrame:
    """Returns a row per task, kind, variant and number of latents of finished encoders.

    Columns: task, kind, settings (the options that distinguish a variant), latents, seeds, and the
    medians across seeds of test_mse; of the unexplained fractions of the variance test, pca and
    random (held-out episodes), heuristic and pca_heuristic (the heuristic's); of the R² of
    yaw_rate, forward_speed, tilt_rate and reward; and of the effective_rank. The last five are NaN
    for encoders that were trained before they were measured.
    """
    encoders, errors = (
        tables[name].to_pandas(use_threads=False) for name in ("encoders", "encoder_errors")
    )
    finished = encoders[(encoders["status"] == "finished") & encoders["kind"].notna()]
    if task is not None:
        finished = finished[finished["task"] == task]
    rows = finished.drop(columns=["test_mse", "test_explained"]).merge(errors, on="encoder")
    medians = ("test_mse", *_FRACTIONS, *PREDICTED, "effective_rank")
    columns = ["task", "kind", "settings", "latents", "seeds", *medians]
    if rows.empty:
        return pd.DataFrame(columns=columns)
    rows = rows.assign(settings=_labels(rows))
    for name in _FRACTIONS:
        rows[name] = 1 - rows[f"{name}_explained"]
    predictions = tables["encoder_predictions"].to_pandas(use_threads=False)
    r2 = predictions.pivot_table(values="r2", index="encoder", columns="target", observed=True)
    rows = rows.merge(r2.reindex(columns=list(PREDICTED)), on="encoder", how="left")
    rows["effective_rank"] = rows["effective_rank"].astype(float)
    table = (
        rows.groupby(["task", "kind", "settings", "latents"])
        .agg(seeds=("seed", "nunique"), **{name: (name, "median") for name in medians})
        .reset_index()
    )
    kinds = {kind: i for i, kind in enumerate(in_order(table["kind"], tuple(ENCODER_KINDS)))}
    orders = {"task": {name: i for i, name in enumerate(TASKS)}, "kind": kinds}
    ordered: pd.DataFrame = table.sort_values(
        ["task", "kind", "settings", "latents"],
        key=lambda column: column.map(orders[column.name]) if column.name in orders else column,
        ignore_index=True,
    )
    return ordered


def error_figure(table: pd.DataFrame) -> Figure:
    """Returns the figure of error against number of latents."""
    drawn = np.maximum(table[list(_DATA)].to_numpy(np.float64), _FLOOR)
    known = drawn[np.isfinite(drawn)]
    limits = np.min(known, initial=1) / 1.4, np.max(known, initial=1) * 1.3
    y = Axis("variance not explained", limits, log=True)
    whole = ReferenceLine(1, Style("0.6", width=0.8))
    panels = [
        Panel(task, latents_axis(rows), y, _error_series(rows), [whole])
        for task, rows in by_task(table).items()
    ]
    key = [
        (_LABELS[data], Style(KEY_COLOR, dash, _WIDTH, marker="o", size=6, hollow=data != "test"))
        for data, dash in _DATA.items()
    ]
    note = (
        "Unexplained fraction of the variance of all scaled features; medians across seeds. ddae "
        "is scored on the state some steps later, part of which is unpredictable; planar does not "
        "decode the robot's position and heading, which count as unexplained. Fractions below "
        f"{_FLOOR:g} are drawn at {_FLOOR:g}."
    )
    return Figure("Error against number of latents", panels, key, [note])


def _error_series(rows: pd.DataFrame) -> list[Series]:
    """Returns the series of a task, two for each kind of encoder."""
    variants: dict[str, int] = {}
    series = []
    for (kind, settings), group in rows.groupby(["kind", "settings"], sort=False):
        color, marker = look_of(str(kind))
        # Variants of a kind share its color; all but the first have thinner lines.
        nth = variants[str(kind)] = variants.get(str(kind), -1) + 1
        # The first kinds are drawn above the others.
        zorder = 10 - 0.1 * len(variants) - 0.01 * nth
        for data, dash in _DATA.items():
            test = data == "test"
            width, size = (_WIDTH, 4.5) if test else (0.6 * _WIDTH, 3.5)
            style = Style(color, dash, width / (1 + nth), marker=marker, size=size, hollow=not test)
            label = encoder_name(kind, settings) if test else ""
            y = np.maximum(column_of(group, data), _FLOOR)
            series.append(Series(column_of(group, "latents"), y, style, label, zorder=zorder))
    return series


def by_task(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Returns the rows of each task."""
    return {task: table[table["task"] == task] for task in in_order(table["task"], TASKS)}


def latents_axis(rows: pd.DataFrame) -> Axis:
    """Returns an axis over the numbers of latents."""
    return Axis("latents", padded(column_of(rows, "latents")), integer=True)


def column_of(rows: pd.DataFrame, name: str) -> FloatArray:
    """Returns a column as numbers."""
    return rows[name].to_numpy(np.float64)


def encoder_name(kind: object, settings: object) -> str:
    """Returns the name of a variant of a kind in legends."""
    return " ".join(filter(None, (str(kind), str(settings))))


def _labels(rows: pd.DataFrame) -> list[str]:
    """Returns the options that distinguish each row's variant within its task and kind."""
    recorded = [json.loads(text) for text in rows["settings"]]
    kept = [{n: v for n, v in one.items() if n not in ENCODER_VARIANT} for one in recorded]
    hashes = [settings_hash(variant) for variant in kept]
    keys = list(zip(rows["task"], rows["kind"], strict=True))
    variants: dict[tuple[str, str], dict[str, dict[str, Any]]] = {}
    for key, name, variant in zip(keys, hashes, kept, strict=True):
        variants.setdefault(key, {})[name] = variant
    labels = {key: variant_labels(found) for key, found in variants.items()}
    return [labels[key][name] for key, name in zip(keys, hashes, strict=True)]
