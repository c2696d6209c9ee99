"""Builds configurations from rows of the database.

A run that diverged counts with the `diverged_return` from then on. If diverged seeds were left out,
an algorithm that diverges half of the time would look as good as one that never does.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.array_types import FloatArray
from jbench.names import ReturnsName
from jbench.report.data.code import note_changes, recorded_code, split_by_code
from jbench.report.data.configuration import KEY, Configuration
from jbench.report.data.encoder_weights import recorded_weights
from jbench.report.data.notes import notes_on_points, notes_on_runs
from jbench.report.data.order import paper_order
from jbench.report.data.points import (
    CONTROL_STEPS,
    NOTHING,
    RETURN,
    Points,
    count_divergence,
    run_points,
    stacked,
)
from jbench.report.data.source_names import OWN
from jbench.returns import EVALUATION, TRAINING, diverged_return
from jbench.settings.code_words import code_dates
from jbench.settings.defaults import foreign_differences
from jbench.settings.recorded import comparable, parse_run
from jbench.settings.variants import variant_words

_ORDER = ["seed", "reached", "recorded", "steps", "run"]
_ASCENDING = [True, False, False, False, True]

PointsByKind = Mapping[ReturnsName, Mapping[str, FloatArray]]
"""Points by kind of return and run; see `run_points`."""


def usable_runs(runs: pa.Table) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs that belong to a configuration, and a sentence for each other run."""
    frame = runs.to_pandas(use_threads=False)
    incomplete = frame[[*KEY, "seed"]].isna().any(axis=1)
    problems = [
        f"The settings of the run {run} lack a task, algo, representation or seed; it is not "
        "reported."
        for run in frame.loc[incomplete, "run"]
    ]
    return frame[~incomplete].astype({"seed": np.int64}), problems


def divergence(recorded: str | None) -> tuple[float, str]:
    """Returns when a run diverged, in control steps and in words; NaN: never. It is untrusted."""
    if not isinstance(recorded, str):
        return np.nan, ""

    values: Any = json.loads(recorded)
    steps = _count(values.get("control_steps")) or 0
    update = _count(values.get("update"))
    words = [f"after {steps:,} control steps"]
    if update is not None:
        words.append(f"update {update:,}")
    what = values.get("what")
    if isinstance(what, str) and what:
        words.append(what)

    return steps, ", ".join(words)


def _count(recorded: object) -> int | None:
    """Returns a recorded count, or None if it is none."""
    return recorded if isinstance(recorded, int) and 0 <= recorded < 1 << 62 else None


def build(
    runs: pd.DataFrame,
    episodes: pa.Table,
    evaluations: pa.Table,
    source: str = OWN,
    encoders: Mapping[str, str] | None = None,
) -> tuple[list[Configuration], list[str]]:
    """Returns the configurations in the order of the paper, and notes on runs that are in none.

    These are runs without episodes, and those that diverged before there was any return from which
    a `diverged_return` follows.

    Runs with the same settings have training returns if any has training episodes, and evaluation
    returns if any was evaluated. The tables of episodes and evaluations may contain other runs.
    `encoders` are names of encoders by id; see `variant_words`.
    """
    points: dict[ReturnsName, dict[str, FloatArray]] = {
        TRAINING: run_points(episodes, TRAINING),
        EVALUATION: run_points(evaluations, EVALUATION),
    }
    begun = dict(zip(runs["run"], runs["created"].astype(str), strict=True))
    runs = _described(runs, points)

    # Evaluation does not affect training, so runs that differ only in it are one configuration.
    alike = runs["typed"].map(comparable)
    runs["variant"] = runs.groupby(alike)["variant"].transform("min")
    codes = split_by_code(runs, alike)
    runs["settings_variant"] = runs["variant"]
    runs["variant"] += codes.where(codes == "", "-" + codes.str.replace(" ", "-"))
    dates = code_dates(zip(runs["typed"], runs["created"], strict=True))

    used, notes = _used(runs)
    foreign = foreign_differences(used["typed"])
    built: list[Configuration] = []
    for (algo, _), group in used.groupby(["algo", "representation"]):
        variants = dict(zip(group["settings_variant"], group["typed"], strict=True))
        words = variant_words(variants, dates, encoders, foreign.get(str(algo), ()))
        for _, same in group.groupby(["task", "variant"]):
            same = same.sort_values(_ORDER, ascending=_ASCENDING)
            code = codes[same.index[0]]
            named = words[same["settings_variant"].iloc[0]] + ([code] if code else [])
            built += _build(same, points, source, named)

    built.sort(key=lambda config: (*paper_order(config), config.words))
    note_changes(built, dict(zip(runs["run"], runs["code"], strict=True)), begun)
    # Recorded settings may differ in nothing that has a name: then a hash tells them apart.
    known_names: dict[str, str] = {}
    for config in built:
        if known_names.setdefault(config.configuration, config.variant) != config.variant:
            config.set_words((*config.each_word, config.variant))

    return built, notes


def _described(runs: pd.DataFrame, points: PointsByKind) -> pd.DataFrame:
    """Returns what `Configuration` and notes need of runs, without other, long texts.

    Further columns: recorded (number of points), reached (control steps at the last one), diverged
    (control steps; NaN: never) and divergence (in words), lowest (what a diverged run counts
    with), typed (its settings, read), code (what is recorded of users' code) and weights (checksum
    of those of its encoder; None: unknown).
    """
    known = {**points[EVALUATION], **points[TRAINING]}
    recorded = [known.get(run, NOTHING) for run in runs["run"]]
    ends = [divergence(text) for text in runs["diverged"]]
    lowest = [
        diverged_return(points[TRAINING].get(run, NOTHING)[:, RETURN], task)
        for run, task in zip(runs["run"], runs["task"], strict=True)
    ]
    settings = [parse_run(text) for text in runs["settings"]]
    provenance = runs["provenance"] if "provenance" in runs else [None] * len(runs)
    code = [recorded_code(text) for text in provenance]
    weights = [recorded_weights(text) for text in provenance]

    return runs[[*KEY, "run", "seed", "steps", "status", "encoder", "created"]].assign(
        recorded=[len(made) for made in recorded],
        reached=[np.nanmax(made[:, CONTROL_STEPS], initial=0.0) for made in recorded],
        diverged=[at for at, _ in ends],
        divergence=[words for _, words in ends],
        lowest=np.array(lowest, float),
        typed=pd.Series(settings, runs.index, object),
        code=pd.Series(code, runs.index, object),
        weights=pd.Series(weights, runs.index, object),
    )


def _used(runs: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs that have returns or count with one, and a note on each other run."""
    has_diverged = runs["diverged"].notna()
    is_idle = ~has_diverged & (runs["recorded"] == 0)
    is_lost = has_diverged & runs["lowest"].isna()
    notes = [
        f"The run {run} ({status}) has no episodes yet."
        for run, status in zip(runs["run"][is_idle], runs["status"][is_idle], strict=True)
    ]
    notes += [
        f"The run {run} diverged before its first episode ended, so it has no return; it is left "
        "out, and its configuration looks better than it is."
        for run in runs["run"][is_lost]
    ]
    return runs[~is_idle & ~is_lost], notes


def _build(
    same: pd.DataFrame, points: PointsByKind, source: str, words: Sequence[str]
) -> Iterator[Configuration]:
    """Yields a configuration for each kind of return of runs, the longest of each seed first."""
    chosen = same.drop_duplicates("seed")
    has_diverged = chosen["diverged"].notna()
    was_evaluated = np.array([bool(run.evaluate_episodes) for run in chosen["typed"]])
    # Those that would have returns of a kind if they had not diverged.
    expected = {TRAINING: has_diverged, EVALUATION: has_diverged & was_evaluated}

    notes: list[str] | None = None
    for kind, recorded in points.items():
        # `isin` would look at all runs of the results for each configuration.
        has_points = chosen["run"].map(recorded.__contains__) | expected[kind]
        if not has_points.any():
            continue

        # Both kinds are of the same runs, on which only the first one has notes.
        notes = notes_on_runs(same, chosen, kind, source, words) if notes is None else []
        used = chosen[has_points]
        missing = len(chosen) - len(used)
        if missing:
            point = "evaluation" if kind == EVALUATION else "training episode"
            notes = [f"{missing} of {len(chosen)} seeds have no {point}", *notes]

        stacks = stacked([recorded.get(run, NOTHING) for run in used["run"]], kind)
        absent = np.isnan(stacks.returns) & np.isfinite(stacks.control_steps)
        if np.isfinite(used["diverged"].to_numpy(float)).any():
            stacks = _with_divergence(stacks, used, kind)

        config = Configuration(kind, used, stacks, source, words)
        config.notes = (*notes, *notes_on_points(config, absent.sum(axis=1)))
        yield config


def _with_divergence(points: Points, used: pd.DataFrame, kind: ReturnsName) -> Points:
    """Returns the points of runs, with what those that diverged count with from then on."""
    return count_divergence(
        points,
        used["diverged"].to_numpy(float),
        used["lowest"].to_numpy(float),
        planned=int(used["steps"].fillna(0).max()),
        kind=kind,
        episode_steps=used["typed"].iloc[0].episode_steps,
    )
