"""Builds configurations from rows of the database, with notes on unusual runs.

A run that diverged counts with return 0 from then on. If diverged seeds were left out, an algorithm
that diverges half of the time would look as good as one that never does.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import EPISODE_STEPS, ReturnsName
from jbench.report.data.configuration import OWN, Configuration, paper_order, with_unique_names
from jbench.report.data.curves import BAND_SEEDS
from jbench.report.data.points import NOTHING, count_divergence, run_points, stacked
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.settings.alike import comparable
from jbench.settings.run import parse_run
from jbench.settings.variants import variant_words
from jbench.statistics import BoolArray, IntArray
from jbench.wording import are, counted

_KEY = ["task", "algo", "representation", "variant"]
_ORDER, _ASCENDING = ["seed", "recorded", "steps", "run"], [True, False, False, True]
_NAMES = {TRAINING: ("episode", "return"), EVALUATION: ("evaluation", "evaluation")}

Points = Mapping[ReturnsName, Mapping[str, pd.DataFrame]]
"""Points by kind of return and run; see `run_points`."""


def usable_runs(runs: pa.Table) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs that belong to a configuration, and a sentence for each other run."""
    frame = runs.to_pandas(use_threads=False)
    incomplete = frame[[*_KEY, "seed"]].isna().any(axis=1)
    problems = [
        f"The settings of the run {run} lack a task, algo, representation or seed; it is not "
        "reported."
        for run in frame.loc[incomplete, "run"]
    ]
    return frame[~incomplete].astype({"seed": np.int64}), problems


def divergence(recorded: str | None) -> tuple[int, str] | None:
    """Returns when a run diverged, in control steps and in words, from the column `diverged`.

    It is untrusted. None: it did not diverge.
    """
    if not isinstance(recorded, str):
        return None
    values: Any = json.loads(recorded)
    steps, update = (
        value if isinstance(value, int) and 0 <= value < 1 << 62 else None
        for value in (values.get("control_steps"), values.get("update"))
    )
    words = [f"after {steps or 0:,} control steps"]
    words += [] if update is None else [f"update {update:,}"]
    words += [values["what"]] if isinstance(values.get("what"), str) else []
    return steps or 0, ", ".join(filter(None, words))


def build(
    runs: pd.DataFrame, episodes: pa.Table, evaluations: pa.Table, source: str = OWN
) -> tuple[list[Configuration], list[str]]:
    """Returns the configurations in the order of the paper, and notes on runs that are in none.

    Runs with the same settings have training returns if any has training episodes, and evaluation
    returns if any was evaluated. The tables of episodes and evaluations may contain other runs.
    """
    tables: dict[ReturnsName, pa.Table] = {TRAINING: episodes, EVALUATION: evaluations}
    points = {kind: run_points(table, kind) for kind, table in tables.items()}
    recorded = [
        len(points[TRAINING].get(run, points[EVALUATION].get(run, NOTHING))) for run in runs["run"]
    ]
    # Other columns are left out, since their texts are long.
    runs = runs[[*_KEY, "run", "seed", "steps", "status", "encoder"]].assign(
        recorded=recorded,
        divergence=pd.Series([divergence(t) for t in runs["diverged"]], runs.index, object),
        typed=pd.Series([parse_run(text) for text in runs["settings"]], runs.index, object),
    )
    # Evaluation does not affect training, so runs that differ only in it are one configuration.
    alike = runs["typed"].map(comparable)
    runs["variant"] = runs.groupby(alike)["variant"].transform("min")
    idle = (runs["recorded"] == 0) & runs["divergence"].isna()
    notes = [
        f"The run {run} ({status}) has no episodes yet."
        for run, status in zip(runs["run"][idle], runs["status"][idle], strict=True)
    ]
    built = []
    for _, group in runs[~idle].groupby(["algo", "representation"]):
        words = variant_words(dict(zip(group["variant"], group["typed"], strict=True)))
        for _, same in group.groupby(["task", "variant"]):
            same = same.sort_values(_ORDER, ascending=_ASCENDING)
            built += _build_kinds(same, points, words[same["variant"].iloc[0]], source)
    built.sort(key=lambda one: one.words)
    return with_unique_names(sorted(built, key=paper_order)), notes


def _build_kinds(
    same: pd.DataFrame, points: Points, words: str, source: str
) -> list[Configuration]:
    """Returns a configuration for each kind of return of runs, the longest of each seed first.

    Diverged runs have training returns, and evaluations if all runs diverged and planned them.
    """
    chosen = same.drop_duplicates("seed")
    diverged = chosen["divergence"].notna()
    planned = all(run.evaluate_episodes for run in chosen["typed"])
    expected = {TRAINING: diverged.any(), EVALUATION: diverged.all() and planned}
    kinds = [kind for kind in points if expected[kind] or chosen["run"].isin([*points[kind]]).any()]
    built = []
    for kind in kinds:
        # Both kinds are of the same runs, on which only the first one has notes.
        notes = _notes_on_runs(same, chosen, kind) if kind == kinds[0] else []
        built.append(_build(chosen, kind, points[kind], notes, words=words, source=source))
    return built


def _build(
    chosen: pd.DataFrame,
    kind: ReturnsName,
    recorded: Mapping[str, pd.DataFrame],
    notes: Sequence[str],
    **names: str,
) -> Configuration:
    """Returns a configuration of the chosen runs, one of each seed."""
    missing = ~chosen["run"].isin([*recorded]) & chosen["divergence"].isna()
    if missing.any():
        point = "evaluation" if kind == EVALUATION else "training episode"
        notes = [f"{missing.sum()} of {len(chosen)} seeds have no {point}", *notes]
    chosen = chosen[~missing]
    points = stacked([recorded.get(run, NOTHING) for run in chosen["run"]], kind)
    absent = (np.isnan(points["returns"]) & np.isfinite(points["control_steps"])).sum(axis=1)
    typed = chosen["steps"].fillna(0).to_numpy(np.int64)
    planned = int(typed.max())
    diverged = chosen["divergence"].notna().to_numpy()
    at = np.array([one[0] if isinstance(one, tuple) else np.nan for one in chosen["divergence"]])
    if diverged.any():
        points = count_divergence(points, at, planned, kind)
    present = np.isfinite(points["control_steps"])
    lengths = np.max(np.where(present, np.arange(present.shape[1]) + 1, 0), axis=1)
    finished = (chosen["status"] == "finished").to_numpy()
    ends = points["control_steps"][np.arange(len(chosen)), lengths - 1]
    steps = np.where(finished & (typed > 0), typed, ends).astype(np.int64)
    if diverged.any() and not diverged.all():
        steps[diverged] = np.maximum(steps[diverged], steps[~diverged].max())
    first = chosen.iloc[0]
    robots = 0 if first["typed"].augment is None else first["typed"].robots
    episodes = max(planned // EPISODE_STEPS, present.shape[1])
    fields: Any = {name: str(first[name]) for name in _KEY} | names | points
    return Configuration(
        kind=kind,
        **fields,
        seeds=chosen["seed"].to_numpy(np.int64),
        lengths=lengths.astype(np.int64),
        steps=steps,
        diverged=diverged,
        finished=finished,
        notes=(*notes, *_notes_on_points(chosen["seed"], present, absent, kind)),
        robots=robots,
        robot_episodes=-(-episodes // robots) if robots else 0,
        settings=first["typed"],
        draws=chosen["encoder"].nunique(),
        runs=tuple(chosen["run"]),
    )


def _notes_on_runs(same: pd.DataFrame, chosen: pd.DataFrame, kind: ReturnsName) -> list[str]:
    """Returns notes on unusual ones of the runs of the same settings, of which some are chosen."""
    notes = []
    point = _NAMES[kind][0]
    if len(chosen) < BAND_SEEDS:
        seeds = counted(len(chosen), "seed")
        notes.append(f"only {seeds}: no band is drawn, and quantiles across seeds say little")
    lengths = dict(zip(chosen["seed"], chosen["recorded"], strict=True))
    for seed, recorded in same.drop(chosen.index).groupby("seed")["recorded"]:
        notes.append(
            f"seed {seed} has {len(recorded) + 1} runs: the longest is used, of {lengths[seed]} "
            f"{point}s, not that of {', '.join(map(str, recorded))}"
        )
    diverged = chosen[chosen["divergence"].notna()]
    which = [
        f"seed {seed} {words}"
        for seed, (_, words) in zip(diverged["seed"], diverged["divergence"], strict=True)
    ]
    if which:
        notes.append(
            f"{len(which)} of {len(chosen)} diverged ({', '.join(which)}): from its divergence on, "
            "a seed counts with return 0, the minimum"
        )
    others = chosen[chosen["divergence"].isna()]
    for ended in ("failed", "unfinished"):
        for seed in others["seed"][others["status"] == ended]:
            notes.append(f"seed {seed} {ended} after {counted(lengths[seed], point)}")
    different = others["recorded"]
    if different.nunique() > 1:
        notes.append(f"seeds of unequal length, {different.min()} to {different.max()} {point}s")
    return notes


def _notes_on_points(
    seeds: pd.Series, present: BoolArray, absent: IntArray, kind: ReturnsName
) -> list[str]:
    """Returns notes on non-finite returns (seeds,), and on evaluations at different steps."""
    notes = [
        f"{counted(count, _NAMES[kind][1])} of seed {seed} {are(count)} not finite and left out"
        for seed, count in zip(seeds, absent, strict=True)
        if count
    ]
    # A gap after a run's last point is its end; a gap before it is a missing evaluation.
    ended = ~np.logical_or.accumulate(present[:, ::-1], axis=1)[:, ::-1]
    if kind == EVALUATION and not (present | ended).all():
        notes.append("seeds were evaluated after different numbers of control steps")
    return notes
