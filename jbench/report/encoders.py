"""Frames of encoders: what latents lose, what they predict, and the returns of agents on them."""

import json
import re
from collections.abc import Mapping
from statistics import multimode

import pandas as pd

from jbench.names import TASKS
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configurations, differing_in
from jbench.report.data.order import in_order
from jbench.representation_names import ENCODER_KINDS, kind_in, shown_representation
from jbench.settings.base import settings_hash, task_and_representation
from jbench.settings.code_words import CodeVersion, first_dates
from jbench.settings.recorded import ENCODER_VARIANT
from jbench.settings.variants import variant_labels
from jbench.statistics import bootstrap as st

PREDICTED = {n: n.replace("_", " ") for n in ("yaw_rate", "forward_speed", "tilt_rate", "reward")}
"""Names of the predicted quantities of the next control step, by column."""

_FRACTIONS = ("test", "pca", "random", "heuristic", "pca_heuristic")
_MEDIANS = ("test_mse", *_FRACTIONS, *PREDICTED, "effective_rank")
_WHOLE = 0.9995
"""A share that is shown as 1."""

_COLUMNS = ["task", "kind", "representation", "settings", "latents", "seeds", *_MEDIANS]


def descriptions(tables: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Returns what the authors of kinds of encoders say of them, by the name of the kind."""
    described = {}
    for row in tables["encoders"].to_dict("records"):
        recorded = json.loads(row["provenance"]) if isinstance(row["provenance"], str) else None
        text = recorded.get("description") if isinstance(recorded, dict) else None
        if isinstance(text, str) and text:
            _, representation = task_and_representation(str(row["encoder"]))
            described[kind_in(representation)] = text
    return described


def encoder_frame(tables: Mapping[str, pd.DataFrame], task: str | None = None) -> pd.DataFrame:
    """Returns a row per task, kind, variant and number of latents of finished encoders.

    settings are the options that distinguish a variant. There are medians across seeds of test_mse;
    of the unexplained fractions of the variance test, pca and random (held-out episodes), heuristic
    and pca_heuristic (the hand-written policy's); and of the R² of `PREDICTED` and effective_rank,
    which are NaN for encoders that were trained before they were measured.
    """
    encoders = tables["encoders"]
    finished = encoders[(encoders["status"] == "finished") & encoders["kind"].notna()]
    if task is not None:
        finished = finished[finished["task"] == task]

    rows = finished.drop(columns=["test_mse", "test_explained"])
    rows = rows.merge(tables["encoder_errors"], on="encoder")
    if rows.empty:
        return pd.DataFrame(columns=_COLUMNS)

    names = rows["encoder"].map(task_and_representation).str[1]  # such as dae12-whitened
    rows["representation"] = names.map(shown_representation)
    codes = [json.loads(text).get("sources") for text in rows["settings"]]
    dates = first_dates(map(CodeVersion, rows["kind"], codes, rows["created"]))
    by_name = rows.groupby(["task", "representation"])
    rows["settings"] = by_name["settings"].transform(_labels, dates)
    for name in _FRACTIONS:
        rows[name] = 1 - rows[f"{name}_explained"]

    predictions = tables["encoder_predictions"]
    r2 = predictions.pivot_table(values="r2", index="encoder", columns="target", observed=True)
    rows = rows.merge(r2.reindex(columns=list(PREDICTED)), on="encoder", how="left")
    rows["effective_rank"] = rows["effective_rank"].astype(float)
    medians = {name: (name, "median") for name in _MEDIANS}
    groups = rows.groupby(_COLUMNS[:5], as_index=False)
    frame = groups.agg(seeds=("seed", "nunique"), **medians)
    order = ["task", "kind", "settings", "latents", "representation"]
    return frame[_COLUMNS].sort_values(order, key=_places, ignore_index=True)


def kept_frame(tables: Mapping[str, pd.DataFrame], task: str | None = None) -> pd.DataFrame:
    """Returns how much of each feature of the observation encoders of one layer keep.

    A row has a task, a representation, a feature, the number of encoders, and the median over them
    of the share `kept` (see `store/kept_features.py`). Encoders that keep every feature whole are
    left out.
    """
    columns = ["task", "representation", "feature", "seeds", "kept"]
    encoders = tables["encoders"]
    if task is not None:
        encoders = encoders[encoders["task"] == task]

    features = tables["encoder_features"]
    rows = encoders[["encoder", "task"]].merge(features[features["kept"].notna()], on="encoder")
    if rows.empty:
        return pd.DataFrame(columns=columns)

    names = rows["encoder"].map(task_and_representation).str[1]
    rows["representation"] = names.map(shown_representation)
    groups = rows.groupby(["task", "representation", "feature"], as_index=False, sort=False)
    frame = groups.agg(seeds=("encoder", "nunique"), kept=("kept", "median"))

    least = frame.groupby(["task", "representation"])["kept"].transform("min")
    frame = frame[least < _WHOLE]

    order = ["task", "representation"]
    return frame[columns].sort_values(order, key=_places, kind="stable", ignore_index=True)


def _places(column: pd.Series) -> pd.Series:
    """Returns what a column is sorted by: places of tasks and kinds, other values themselves."""
    known = {"task": TASKS, "kind": tuple(ENCODER_KINDS)}.get(str(column.name))
    if known is None:
        return column

    ordered = in_order(column, known)
    return column.map(ordered.index)


def prediction_frame(configurations: Configurations, encoders: pd.DataFrame) -> pd.DataFrame:
    """Returns the final returns, of one kind, beside what latents predict.

    Only for tasks and algorithms with three or more measured representations. Representations with
    several variants of an encoder are left out, because runs do not say which of them they observe.
    """
    returns = return_frame(configurations)
    keys = ["task", "representation"]
    measured = encoders[~encoders.duplicated(keys, keep=False) & encoders["yaw_rate"].notna()]
    rows = returns.merge(measured[[*keys, *PREDICTED]], on=keys)
    group = ["source", "task", "algo", "words"]
    rows = rows[rows.groupby(group)["label"].transform("size") >= 3]
    long = rows.melt([*returns], [*PREDICTED], "quantity", "r2")
    return long.assign(quantity=long["quantity"].map(PREDICTED))


def return_frame(configurations: Configurations) -> pd.DataFrame:
    """Returns the final returns of configurations that differ only in their representation.

    They are measured at the number of control steps for which most of these configurations were
    trained, or at the largest of several such; those that were trained for fewer are left out. iqm
    has a 95% interval.
    """
    rows = []
    for group in differing_in(configurations, "representation"):
        end = max(multimode(config.trained for config in group))
        for config in (config for config in group if config.trained >= end):
            final = seed_scores(config, end).final
            value, low, high, _ = st.estimate(st.interquartile_mean, [final])
            numbers = {"steps": end, "seeds": len(final), "iqm": value, "low": low, "high": high}
            rows.append(config.identity | numbers)

    return pd.DataFrame(rows, columns=[*ID, "steps", "seeds", "iqm", "low", "high"])


def _labels(texts: pd.Series, dates: Mapping[str, str]) -> list[str]:
    """Returns the options that distinguish each variant of encoders of one task and name.

    The names of newer encoders have all their options. `dates` are those of users' code.
    """
    options = [
        {name: value for name, value in json.loads(text).items() if name not in ENCODER_VARIANT}
        for text in texts
    ]
    hashes = list(map(settings_hash, options))
    labels = variant_labels(dict(zip(hashes, options, strict=True)), dates)
    # An option that is not set has its default.
    redundant = re.compile(r"\w+=\(not set\)(, )?")
    return [redundant.sub("", labels[name]).strip(", ") for name in hashes]
