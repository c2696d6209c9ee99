"""Cells: the runs of a database that share all their settings but seed and steps."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import ALGORITHMS, EPISODE_STEPS, FULL, TASKS
from jbench.report.curves import FloatArray, IntArray
from jbench.report.variants import comparable, variant_labels
from jbench.store.identity import settings_hash

OURS = "ours"
"""The source of the runs of the results that are reported."""

_KEY = ["task", "algo", "representation", "variant"]


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
        wall_time: (seeds, episodes) s since the run began at an episode's end; NaN past its end.
        settings: of its runs, one seed's.
        source: whose runs they are: `OURS`, or another name.
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
    robots: int
    robot_episodes: int
    wall_time: FloatArray
    settings: Mapping[str, Any]
    source: str = OURS

    @property
    def name(self) -> str:
        """Names the cell for a reader."""
        name = f"{self.task} {self.algo} {self.representation} {self.label or self.variant}"
        return f"{self.prefix}{name}"

    @property
    def prefix(self) -> str:
        """Whose runs they are, in front of a name; nothing for ours."""
        return "" if self.source == OURS else f"{self.source}: "

    @property
    def seen(self) -> str:
        """What its agents see, and the settings that set it apart from other variants."""
        return ", ".join(filter(None, (self.representation, self.label)))

    def same_but(self, other: "Cell", *names: str) -> bool:
        """Returns whether two cells differ in nothing else than these settings.

        Seeds, steps and how often agents are evaluated are no difference; nor is what can't stay
        the same where a named setting does not, as the encoder of another representation.
        """
        mine, others = (comparable(cell.settings, *names) for cell in (self, other))
        return mine == others


class Recorded(NamedTuple):
    """The episodes of a run, in their order; each (episodes,)."""

    returns: FloatArray
    control_steps: FloatArray
    wall_time: FloatArray


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


def build_cells(
    runs: pd.DataFrame, episodes: pa.Table, source: str = OURS
) -> tuple[list[Cell], list[str]]:
    """Returns the cells in the order of the paper, and notes on runs that are in none.

    Args:
        runs: rows of the table `runs`, as `usable_runs` returns them.
        episodes: the table `episodes`, of these runs and perhaps of others.
        source: of the cells.
    """
    recorded = _split_by_run(episodes)
    runs = runs.assign(
        recorded=[len(recorded[run].returns) if run in recorded else 0 for run in runs["run"]]
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
            _build_cell(group[group["variant"] == variant], label, recorded, source)
            for variant, label in labels.items()
        ]
    return sorted(cells, key=paper_order), notes


def in_order(names: Iterable[str], known: tuple[str, ...]) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others in the alphabet's."""
    distinct = set(names)
    return [name for name in known if name in distinct] + sorted(distinct - set(known))


def file_name(*parts: str) -> str:
    """Returns a file name that starts with these parts, whatever they hold."""
    plain = "-".join(re.sub(r"[^A-Za-z0-9_.]", "_", part)[:60] for part in parts)
    if plain == "-".join(parts):
        return plain
    return f"{plain}-{settings_hash({'name': parts})}"


def _build_cell(
    runs: pd.DataFrame, label: str, recorded: Mapping[str, Recorded], source: str
) -> Cell:
    runs = runs.sort_values(
        ["seed", "recorded", "steps", "run"], ascending=[True, False, False, True]
    )
    chosen = runs.drop_duplicates("seed")
    lengths = chosen["recorded"].to_numpy(np.int64)
    shape = (len(chosen), int(lengths.max()))
    returns, control_steps, wall_time = (np.full(shape, np.nan) for _ in range(3))
    for row, run in enumerate(chosen["run"]):
        for whole, part in zip((returns, control_steps, wall_time), recorded[run], strict=True):
            whole[row, : lengths[row]] = part
    first = chosen.iloc[0]
    settings = json.loads(first["settings"])
    robots = _robots(settings)
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
        wall_time=wall_time,
        settings=settings,
        source=source,
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


def _split_by_run(episodes: pa.Table) -> dict[str, Recorded]:
    """Returns the episodes of each run, in their order."""
    run = episodes["run"]
    if pa.types.is_dictionary(run.type):
        run = run.unify_dictionaries().combine_chunks()
    else:
        run = run.combine_chunks().dictionary_encode()
    codes = run.indices.to_numpy()
    order = np.lexsort((episodes["episode"].to_numpy(), codes))
    columns = [
        episodes[name].to_numpy().astype(np.float64, copy=False)[order]
        for name in ("episode_return", "control_steps", "wall_time")
    ]
    columns[0][~np.isfinite(columns[0])] = np.nan
    ends = np.cumsum(np.bincount(codes, minlength=len(run.dictionary)))[:-1]
    parts = zip(*(np.split(column, ends) for column in columns), strict=True)
    return {
        name: Recorded(*part) for name, part in zip(run.dictionary.to_pylist(), parts, strict=False)
    }


def paper_order(cell: Cell) -> tuple[Any, ...]:
    """Returns what cells are sorted by: task, algorithm and representation as in the paper."""
    # Stable, so that variants stay in the order of their labels.
    return (
        (TASKS.index(cell.task), "") if cell.task in TASKS else (len(TASKS), cell.task),
        (ALGORITHMS.index(cell.algo), "")
        if cell.algo in ALGORITHMS
        else (len(ALGORITHMS), cell.algo),
        cell.representation != FULL,
        cell.representation,
        cell.source,
    )
