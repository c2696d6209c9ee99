"""Builds configurations from rows of the database, with notes on unusual runs.

A run that diverged counts with the `diverged_return` from then on. If diverged seeds were left out,
an algorithm that diverges half of the time would look as good as one that never does.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import ReturnsName
from jbench.report.data.code import note_changes, recorded_code, split_by_code
from jbench.report.data.configuration import KEY, Configuration, paper_order
from jbench.report.data.points import (
    CONTROL_STEPS,
    NOTHING,
    RETURN,
    count_divergence,
    run_points,
    stacked,
)
from jbench.report.data.source_names import FILE, OWN, has_return_range
from jbench.returns import EVALUATION, TRAINING, diverged_return
from jbench.settings.code_words import code_dates
from jbench.settings.recorded import comparable, parse_run
from jbench.settings.variants import CUT, chosen_words, variant_words
from jbench.statistics import FloatArray, IntArray
from jbench.statistics.bootstrap import MIN_SEEDS
from jbench.wording import are, counted

_ORDER = ["seed", "reached", "recorded", "steps", "run"]
_ASCENDING = [True, False, False, False, True]
_NAMES = {TRAINING: ("episode", "return"), EVALUATION: ("evaluation", "evaluation")}

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
    steps, update = (
        value if isinstance(value, int) and 0 <= value < 1 << 62 else None
        for value in (values.get("control_steps"), values.get("update"))
    )
    words = [f"after {steps or 0:,} control steps", "" if update is None else f"update {update:,}"]
    if isinstance(values.get("what"), str):
        words.append(values["what"])

    return steps or 0, ", ".join(filter(None, words))


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
    built: list[Configuration] = []
    for _, group in used.groupby(["algo", "representation"]):
        words = variant_words(
            dict(zip(group["settings_variant"], group["typed"], strict=True)), dates, encoders
        )
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
    with), typed (its settings, read) and code (what is recorded of users' code).
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

    return runs[[*KEY, "run", "seed", "steps", "status", "encoder", "created"]].assign(
        recorded=[len(made) for made in recorded],
        reached=[np.nanmax(made[:, CONTROL_STEPS], initial=0.0) for made in recorded],
        diverged=[at for at, _ in ends],
        divergence=[words for _, words in ends],
        lowest=np.array(lowest, float),
        typed=pd.Series(settings, runs.index, object),
        code=pd.Series(code, runs.index, object),
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
    diverged = chosen["diverged"].notna()
    planned = np.array([bool(run.evaluate_episodes) for run in chosen["typed"]])
    # Those that would have returns of a kind if they had not diverged.
    expected = {TRAINING: diverged, EVALUATION: diverged & planned}
    notes: list[str] | None = None
    for kind, recorded in points.items():
        known = chosen["run"].isin([*recorded])
        has_points = known | expected[kind]
        if not has_points.any():
            continue
        # Both kinds are of the same runs, on which only the first one has notes.
        notes = _notes_on_runs(same, chosen, kind, words) if notes is None else []
        used = chosen[has_points]
        if missing := len(chosen) - len(used):
            point = "evaluation" if kind == EVALUATION else "training episode"
            notes = [f"{missing} of {len(chosen)} seeds have no {point}", *notes]
        stacks = stacked([recorded.get(run, NOTHING) for run in used["run"]], kind)
        absent = np.isnan(stacks.returns) & np.isfinite(stacks.control_steps)
        at = used["diverged"].to_numpy(float)
        if np.isfinite(at).any():
            longest = int(used["steps"].fillna(0).max())
            length = used["typed"].iloc[0].episode_steps
            lowest = used["lowest"].to_numpy(float)
            stacks = count_divergence(stacks, at, lowest, longest, kind, length)

        config = Configuration(kind, used, stacks, source, words)
        config.notes = (*notes, *_notes_on_points(config, absent.sum(axis=1)))
        yield config


def _notes_on_runs(
    same: pd.DataFrame, chosen: pd.DataFrame, kind: ReturnsName, words: Sequence[str]
) -> list[str]:
    """Returns notes on unusual ones of the runs of the same settings, of which some are chosen."""
    point = _NAMES[kind][0]
    notes = []
    is_cut = any(CUT in word for word in words)
    if is_cut and (every := chosen_words(chosen["typed"].iloc[0])):
        notes.append(f"its settings other than the defaults: {every}")

    if len(chosen) < MIN_SEEDS:
        few = f"only {counted(len(chosen), 'seed')}"
        notes.append(f"{few}: too few for a band and for quantiles")

    lengths = dict(zip(chosen["seed"], chosen["recorded"], strict=True))
    for seed, recorded in same.drop(chosen.index).groupby("seed")["recorded"]:
        notes.append(
            f"seed {seed} has {len(recorded) + 1} runs: the longest is used, of {lengths[seed]} "
            f"{point}s, not that of {', '.join(map(str, recorded))}"
        )

    others = chosen[chosen["diverged"].isna()]
    diverged = chosen[chosen["diverged"].notna()]
    if len(diverged):
        which = ", ".join("seed " + diverged["seed"].astype(str) + " " + diverged["divergence"])
        notes.append(
            f"{len(diverged)} of {len(chosen)} diverged ({which}): from its divergence on, a seed "
            f"counts with {_what_counts(diverged)}"
        )

    for ended in ("failed", "unfinished"):
        for seed in others["seed"][others["status"] == ended]:
            notes.append(f"seed {seed} {ended} after {counted(lengths[seed], point)}")

    # Where episodes end early, runs of the same control steps have other numbers of them.
    is_whole = others["steps"].nunique() == 1 and (others["status"] == "finished").all()
    if (different := others["recorded"]).nunique() > 1 and not is_whole:
        notes.append(f"seeds of unequal length, {different.min()} to {different.max()} {point}s")

    return notes


def _what_counts(diverged: pd.DataFrame) -> str:
    """Returns what each of some runs counts with from its divergence on."""
    is_negative = diverged["lowest"] < 0
    if is_negative.all():
        return "its lowest training return"
    if is_negative.any():
        seeds = ", ".join(diverged["seed"][~is_negative].astype(str))
        return f"its lowest training return (seed {seeds}: 0, which is lower)"

    is_minimum = has_return_range(diverged["task"], ())
    return "return 0, the minimum" if is_minimum else "return 0, which is lower than its returns"


def _notes_on_points(config: Configuration, absent: IntArray) -> list[str]:
    """Returns notes on returns that are not finite, and on the control steps of points."""
    notes = [
        f"{counted(count, _NAMES[config.kind][1])} of seed {seed} {are(count)} not finite and left "
        "out"
        for seed, count in zip(config.seeds, absent, strict=True)
        if count
    ]
    return notes + _notes_on_steps(config)


def _notes_on_steps(config: Configuration) -> list[str]:
    """Returns notes on seeds that were logged, or ended, at different control steps."""
    common = config.common
    if common.interpolated and not len(common.control_steps):
        return ["its seeds have no control step in common, so it has no curve"]

    notes = []
    if common.interpolated:
        notes.append(
            "its seeds were logged at different control steps: each is interpolated linearly "
            "between its own points"
        )

    if len(common.control_steps) and (end := common.control_steps[-1]) < config.longest:
        of = "" if config.source == FILE else f" of {config.kind} returns"
        notes.append(
            f"its curve{of} ends at {end:,.0f} control steps, the last that every seed has reached"
        )

    return notes
