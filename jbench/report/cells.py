"""Cells: the runs of a database that share all their settings but seed and steps."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import ALGORITHMS, EPISODE_STEPS, FULL, TASKS
from jbench.report.curves import FloatArray, IntArray
from jbench.store.identity import settings_hash

_KEY = ["task", "algo", "representation", "variant"]
_NAMED_SETTINGS = 4
_VALUE_LENGTH = 34


@dataclass(frozen=True)
class Cell:
    """One run for each seed of a task, algorithm, representation and variant.

    Attributes:
        task: what was learned.
        algo: by which algorithm.
        representation: `full`, or an encoder's kind and size: `dae12`.
        variant: hash of the settings but seed and steps.
        label: the settings that set it apart from the other variants; empty where there are none.
        seeds: (seeds,) rising.
        returns: (seeds, episodes) episode returns; NaN past a run's end, or if not finite.
        control_steps: (seeds, episodes) of the run at an episode's end; NaN past the run's end.
        lengths: (seeds,) episodes of each run.
        notes: what a reader should know, a clause each.
        robots: augmented robots that were learned on in turn; 0 for the plain robot.
        robot_episodes: episodes with each of them, in the longest run.
    """

    task: str
    algo: str
    representation: str
    variant: str
    label: str
    seeds: IntArray
    returns: FloatArray
    control_steps: FloatArray
    lengths: IntArray
    notes: tuple[str, ...]
    robots: int = 0
    robot_episodes: int = 0

    @property
    def name(self) -> str:
        """Names the cell for a reader."""
        return f"{self.task} {self.algo} {self.representation} {self.label or self.variant}"


def usable_runs(runs: pa.Table) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs that belong to a cell, and a sentence for each that doesn't."""
    frame = runs.to_pandas(use_threads=False)
    wanting = frame[[*_KEY, "seed"]].isna().any(axis=1)
    problems = [
        f"The run {run} says no task, algo, representation or seed in its settings; "
        "it is not reported."
        for run in frame.loc[wanting, "run"]
    ]
    return frame[~wanting].astype({"seed": np.int64}), problems


def build_cells(runs: pd.DataFrame, episodes: pa.Table) -> tuple[list[Cell], list[str]]:
    """Returns the cells in the order of the paper, and notes on runs that are in none.

    Args:
        runs: rows of the table `runs`, as `usable_runs` returns them.
        episodes: the table `episodes`, of these runs and perhaps of others.
    """
    recorded = _split_by_run(episodes)
    runs = runs.assign(
        recorded=[len(recorded[run][0]) if run in recorded else 0 for run in runs["run"]]
    )
    idle = runs[runs["recorded"] == 0]
    notes = [
        f"The run {run} ({status}) has no episodes yet."
        for run, status in zip(idle["run"], idle["status"], strict=True)
    ]
    runs = runs[runs["recorded"] > 0]
    cells = []
    for _, group in runs.groupby(_KEY[:3]):
        labels = variant_labels(dict(zip(group["variant"], group["settings"], strict=True)))
        cells += [
            _build_cell(group[group["variant"] == variant], label, recorded)
            for variant, label in labels.items()
        ]
    return sorted(cells, key=_paper_order), notes


def in_order(names: Iterable[str], known: tuple[str, ...]) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others in the alphabet's."""
    distinct = set(names)
    return [name for name in known if name in distinct] + sorted(distinct - set(known))


def variant_labels(settings: Mapping[str, str]) -> dict[str, str]:
    """Returns a label for each variant: the settings that differ, as `learning_rate=0.001`.

    Args:
        settings: JSON of a run's settings, by variant.

    Returns:
        Labels by variant, in the order of the values that differ; "" for a lone variant.
    """
    flat = {variant: _flatten(json.loads(text)) for variant, text in settings.items()}
    paths = list(dict.fromkeys(path for values in flat.values() for path in values))
    differing = [
        path
        for path in paths
        if path not in (("seed",), ("steps",))
        and len({_exact(values.get(path, ...)) for values in flat.values()}) > 1
    ]
    names = _short_names(differing)
    rows = sorted(
        flat.items(), key=lambda item: ([_rank(item[1].get(path)) for path in differing], item[0])
    )
    labels = {
        variant: ", ".join(
            f"{names[path]}={_text(values.get(path, ...))}" for path in differing[:_NAMED_SETTINGS]
        )
        for variant, values in rows
    }
    # More settings than a label can name, or names cut short, must not make two curves one.
    if len(differing) > _NAMED_SETTINGS or len(set(labels.values())) < len(labels):
        labels = {variant: f"{label}, … ({variant})" for variant, label in labels.items()}
    return labels


def file_name(*parts: str) -> str:
    """Returns a file name that starts with these parts, whatever they hold."""
    plain = "-".join(re.sub(r"[^A-Za-z0-9_.]", "_", part)[:60] for part in parts)
    if plain == "-".join(parts):
        return plain
    return f"{plain}-{settings_hash({'name': parts})}"


def _build_cell(
    runs: pd.DataFrame, label: str, recorded: Mapping[str, tuple[FloatArray, FloatArray]]
) -> Cell:
    runs = runs.sort_values(
        ["seed", "recorded", "steps", "run"], ascending=[True, False, False, True]
    )
    chosen = runs.drop_duplicates("seed")
    lengths = chosen["recorded"].to_numpy(np.int64)
    shape = (len(chosen), int(lengths.max()))
    returns, control_steps = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, run in enumerate(chosen["run"]):
        returns[row, : lengths[row]], control_steps[row, : lengths[row]] = recorded[run]
    first = chosen.iloc[0]
    robots = _robots(json.loads(first["settings"]))
    planned = max(int(chosen["steps"].fillna(0).max()) // EPISODE_STEPS, shape[1])
    return Cell(
        **{name: str(first[name]) for name in _KEY},
        label=label,
        seeds=chosen["seed"].to_numpy(np.int64),
        returns=returns,
        control_steps=control_steps,
        lengths=lengths,
        notes=tuple(_notes(runs, chosen, returns)),
        robots=robots,
        robot_episodes=-(-planned // robots) if robots else 0,
    )


def _robots(settings: Mapping[str, Any]) -> int:
    """Returns the number of augmented robots; 0 for the plain one."""
    robots = settings.get("robots", 1)
    augmented = settings.get("augment") is not None and isinstance(robots, int)
    return robots if augmented else 0


def _notes(runs: pd.DataFrame, chosen: pd.DataFrame, returns: FloatArray) -> list[str]:
    """Says what is special about the runs of a cell; `runs` holds those of the same seed too."""
    notes = []
    if len(chosen) < 3:
        seeds = "1 seed" if len(chosen) == 1 else "2 seeds"
        notes.append(f"only {seeds}: no band is drawn, and quantiles across seeds say little")
    lengths = dict(zip(chosen["seed"], chosen["recorded"], strict=True))
    left_out = runs.drop(chosen.index)
    for seed, group in left_out.groupby("seed"):
        shorter = ", ".join(str(n) for n in group["recorded"])
        notes.append(
            f"seed {seed} has {len(group) + 1} runs: the longest is used, of {lengths[seed]} "
            f"episodes, not that of {shorter}"
        )
    for status in ("failed", "unfinished"):
        for row in chosen[chosen["status"] == status].itertuples():
            notes.append(f"seed {row.seed} {status} after {row.recorded} episodes")
    if chosen["recorded"].nunique() > 1:
        notes.append(
            f"seeds of unequal length, {min(lengths.values())} to {max(lengths.values())} episodes"
        )
    absent = np.isnan(returns).sum(axis=1) - (returns.shape[1] - chosen["recorded"].to_numpy())
    for seed, count in zip(chosen["seed"], absent, strict=True):
        if count:
            notes.append(f"seed {seed} has {count} returns that are not numbers and are left out")
    return notes


def _split_by_run(episodes: pa.Table) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Returns episode returns and control steps of each run, in the order of its episodes."""
    run = episodes["run"].combine_chunks().dictionary_encode()
    codes = run.indices.to_numpy()
    order = np.lexsort((episodes["episode"].to_numpy(), codes))
    returns = episodes["episode_return"].to_numpy().astype(np.float64)[order]
    control_steps = episodes["control_steps"].to_numpy().astype(np.float64)[order]
    returns[~np.isfinite(returns)] = np.nan
    ends = np.cumsum(np.bincount(codes, minlength=len(run.dictionary)))[:-1]
    parts = zip(np.split(returns, ends), np.split(control_steps, ends), strict=True)
    return dict(zip(run.dictionary.to_pylist(), parts, strict=False))


def _paper_order(cell: Cell) -> tuple[Any, ...]:
    # Stable, so that variants stay in the order of their labels.
    return (
        (TASKS.index(cell.task), "") if cell.task in TASKS else (len(TASKS), cell.task),
        (ALGORITHMS.index(cell.algo), "")
        if cell.algo in ALGORITHMS
        else (len(ALGORITHMS), cell.algo),
        cell.representation != FULL,
        cell.representation,
    )


def _flatten(settings: Mapping[str, Any], path: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    flat: dict[tuple[str, ...], Any] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= _flatten(value, (*path, name))
        else:
            flat[(*path, name)] = value
    return flat


def _short_names(paths: list[tuple[str, ...]]) -> dict[tuple[str, ...], str]:
    """Names a setting by its last part alone, where that is enough."""
    last = [path[-1] for path in paths]
    return {path: path[-1] if last.count(path[-1]) == 1 else ".".join(path) for path in paths}


def _text(value: Any) -> str:
    if value is ...:
        return "(not set)"
    text = value if isinstance(value, str) else json.dumps(value)
    half = _VALUE_LENGTH // 2
    return text if len(text) <= _VALUE_LENGTH else f"{text[:half]}…{text[-half:]}"


def _exact(value: Any) -> str | None:
    return None if value is ... else json.dumps(value)


def _rank(value: Any) -> tuple[int, float, str]:
    """Sorts numbers by size, before all else."""
    number = isinstance(value, int | float)
    return (0, value, "") if number else (1, 0.0, _text(value))
