"""Builds cells from rows of the database, with notes on unusual runs."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import EPISODE_STEPS
from jbench.report.data.cells import OWN, Cell, paper_order, with_unique_names
from jbench.report.data.curves import FloatArray, IntArray, Points
from jbench.report.data.divergence import (
    Divergence,
    count_divergence,
    divergence_of,
    on_points,
    on_runs,
)
from jbench.report.data.returns import EVALUATION, TRAINING, Returns
from jbench.settings.run import Run, parse_run
from jbench.settings.variants import variant_words

POINT = ("episode_return", "control_steps", "processor_time")
"""Columns of the tables `episodes` and `evaluations` of which `Points` are made."""

_KEY = ["task", "algo", "representation", "variant"]
_USED = [*_KEY, "run", "seed", "steps", "status", "encoder"]
_ORDER, _ASCENDING = ["seed", "recorded", "steps", "run"], [True, False, False, True]
_NOTHING = Points(*(np.empty(0) for _ in Points._fields))


def usable_runs(runs: pa.Table) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs that belong to a cell, and a sentence for each other run."""
    frame = runs.to_pandas(use_threads=False)
    incomplete = frame[[*_KEY, "seed"]].isna().any(axis=1)
    problems = [
        f"The settings of the run {run} lack a task, algo, representation or seed; it is not "
        "reported."
        for run in frame.loc[incomplete, "run"]
    ]
    return frame[~incomplete].astype({"seed": np.int64}), problems


def with_more_episodes(tables: Mapping[str, pa.Table]) -> pa.Table:
    """Returns the evaluations of runs, and episodes of their policies by `jbench evaluate`.

    These join the last evaluation of a run, if they are on the plain robot with random targets.
    """
    evaluations = tables["evaluations"]
    if "policy_evaluations" not in tables or not evaluations.num_rows:
        return evaluations
    added = tables["policy_evaluations"].to_pandas(use_threads=False)
    plain = [
        settings.get("augment") is None and settings.get("target_yaw") is None
        for settings in map(json.loads, added["settings"])
    ]
    added = added[np.array(plain, bool) & (added["status"] == "finished")]
    episodes = tables["policy_episodes"].to_pandas(use_threads=False)
    episodes = episodes.merge(added[["evaluation", "policy"]], on="evaluation")
    keys = ["run", "evaluation", "control_steps", "processor_time"]
    last = evaluations.select(keys).to_pandas(use_threads=False).astype({"run": str})
    last = last.sort_values("evaluation").groupby("run", as_index=False).last()
    more = episodes[["policy", "episode_return"]].merge(last, left_on="policy", right_on="run")
    more = more.assign(episode=np.arange(len(more)) + 1_000_000)  # never the first of an evaluation
    if more.empty:
        return evaluations
    rows = pa.Table.from_pandas(more[evaluations.column_names], preserve_index=False)
    return pa.concat_tables([evaluations, rows.cast(evaluations.schema)])


def build_cells(
    runs: pd.DataFrame, episodes: pa.Table, evaluations: pa.Table, source: str = OWN
) -> tuple[list[Cell], list[str]]:
    """Returns the cells in the order of the paper, and notes on runs that are in none.

    Runs with the same settings form a cell of training returns, if any has training episodes, and a
    cell of evaluation returns, if any was evaluated.

    Args:
        runs: see `usable_runs`.
        episodes: the table of that name; may contain other runs.
        evaluations: the table of that name; may contain other runs.
    """
    trained, evaluated = _training_points(episodes), _evaluation_points(evaluations)
    # Other columns are left out, since their texts are long.
    runs = runs[_USED].assign(
        recorded=[
            len(trained.get(run, evaluated.get(run, _NOTHING)).returns) for run in runs["run"]
        ],
        divergence=pd.Series([divergence_of(t) for t in runs["diverged"]], runs.index, object),
        typed=pd.Series([parse_run(text) for text in runs["settings"]], runs.index, object),
    )
    idle = (runs["recorded"] == 0) & runs["divergence"].isna()
    notes = [
        f"The run {run} ({status}) has no episodes yet."
        for run, status in zip(runs["run"][idle], runs["status"][idle], strict=True)
    ]
    runs = runs[~idle]
    words = {
        variant: text
        for _, group in runs.groupby(["algo", "representation"])
        for variant, text in variant_words(_settings(group)).items()
    }
    cells = []
    for _, group in runs.groupby(_KEY[:3]):
        for variant in sorted(_settings(group), key=lambda one: words[one]):
            same = group[group["variant"] == variant].sort_values(_ORDER, ascending=_ASCENDING)
            chosen = same.drop_duplicates("seed")
            names = {name: str(chosen[name].iloc[0]) for name in _KEY}
            names |= {"words": words[variant], "source": source}
            recorded = _recorded(chosen, trained, evaluated)
            for i, (kind, points) in enumerate(recorded.items()):
                # Both cells are of the same runs, on which only the first one has notes.
                cells.append(_build_cell(same, chosen, names, kind, points, noted=i == 0))
    return with_unique_names(sorted(cells, key=paper_order)), notes


def _settings(runs: pd.DataFrame) -> dict[str, Run]:
    """Returns the settings of each variant among these runs."""
    return dict(zip(runs["variant"], runs["typed"], strict=True))


def _recorded(
    chosen: pd.DataFrame, trained: Mapping[str, Points], evaluated: Mapping[str, Points]
) -> dict[Returns, Mapping[str, Points]]:
    """Returns the points by run, for each kind of return of which these runs form a cell.

    Diverged runs have training returns, and evaluations if all runs diverged and planned them.
    """
    recorded: dict[Returns, Mapping[str, Points]] = {}
    diverged = chosen["divergence"].notna()
    if any(run in trained for run in chosen["run"]) or diverged.any():
        recorded[TRAINING] = trained
    planned = all(run.evaluate_episodes for run in chosen["typed"])
    if any(run in evaluated for run in chosen["run"]) or (diverged.all() and planned):
        recorded[EVALUATION] = evaluated
    return recorded


def _build_cell(
    runs: pd.DataFrame,
    chosen: pd.DataFrame,
    names: Mapping[str, Any],
    kind: Returns,
    recorded: Mapping[str, Points],
    *,
    noted: bool,
) -> Cell:
    """Returns a cell of the chosen runs, one of each seed.

    Args:
        runs: all runs of its settings.
        names: fields of the cell that are texts, by name.
        recorded: points by run.
        noted: whether the cell has notes on its runs.
    """
    notes = []
    usable = chosen["run"].isin(list(recorded)) | chosen["divergence"].notna()
    if not usable.all():
        point = "evaluation" if kind is EVALUATION else "training episode"
        notes.append(f"{(~usable).sum()} of {len(chosen)} seeds have no {point}")
    chosen = chosen[usable]
    stacked = _stacked([recorded.get(run, _NOTHING) for run in chosen["run"]], kind)
    absent = (np.isnan(stacked.returns) & np.isfinite(stacked.control_steps)).sum(axis=1)
    planned = int(chosen["steps"].fillna(0).max())
    divergences = [one if isinstance(one, Divergence) else None for one in chosen["divergence"]]
    points = count_divergence(stacked, divergences, planned, kind)
    present = np.isfinite(points.control_steps)
    lengths = np.max(np.where(present, np.arange(present.shape[1]) + 1, 0), axis=1)
    if noted:
        notes += on_runs(runs, chosen, divergences, kind)
    notes += on_points(chosen, present, absent, kind)
    settings = chosen["typed"].iloc[0]
    robots = 0 if settings.augment is None else settings.robots
    episodes = max(planned // EPISODE_STEPS, present.shape[1])
    return Cell(
        kind=kind,
        **names,
        seeds=chosen["seed"].to_numpy(np.int64),
        lengths=lengths.astype(np.int64),
        steps=_steps(chosen, points.control_steps, lengths),
        diverged=np.array([one is not None for one in divergences]),
        notes=tuple(notes),
        robots=robots,
        robot_episodes=-(-episodes // robots) if robots else 0,
        settings=settings,
        draws=chosen["encoder"].nunique(),
        runs=tuple(chosen["run"]),
        **points._asdict(),
    )


def _stacked(runs: Sequence[Points], kind: Returns) -> Points:
    """Returns the points of runs stacked, (seeds, points) each, padded with NaN.

    Training episodes are aligned by their index, evaluations by the control steps before them.
    """
    if kind is TRAINING:
        columns = [np.arange(len(run.returns)) for run in runs]
    else:
        steps = np.unique(np.concatenate([run.control_steps for run in runs]))
        columns = [np.searchsorted(steps, run.control_steps) for run in runs]
    shape = (len(runs), max(int(column[-1]) + 1 if len(column) else 0 for column in columns))

    def stack(parts: Sequence[FloatArray]) -> FloatArray:
        whole = np.full(shape, np.nan)
        for row, (part, column) in enumerate(zip(parts, columns, strict=True)):
            whole[row, column] = part
        return whole

    fields = list(zip(*runs, strict=True))
    episodes = _single_episodes(shape) if kind is TRAINING else map(stack, fields[3:])
    return Points(*[*map(stack, fields[:3]), *episodes])


def _single_episodes(shape: int | tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Returns the deviations and counts of training episodes; they take no memory."""
    return np.broadcast_to(np.nan, shape), np.broadcast_to(1.0, shape)


def _steps(chosen: pd.DataFrame, control_steps: FloatArray, lengths: IntArray) -> IntArray:
    """Returns the control steps that each seed was trained for."""
    ends = control_steps[np.arange(len(chosen)), lengths - 1].astype(np.int64)
    planned = chosen["steps"].fillna(0).to_numpy(np.int64)
    finished = (chosen["status"] == "finished").to_numpy() & (planned > 0)
    steps = np.where(finished, planned, ends)
    diverged = chosen["divergence"].notna().to_numpy()
    if diverged.any() and not diverged.all():
        steps[diverged] = np.maximum(steps[diverged], steps[~diverged].max())
    return np.asarray(steps, np.int64)


def _training_points(episodes: pa.Table) -> dict[str, Points]:
    """Returns the training episodes of each run in order; runs without episodes are left out."""
    # Most batches contain a single run; these are not copied.
    of_runs: dict[str, list[pa.RecordBatch]] = {}
    for batch in episodes.to_batches():
        names, codes = coded(pa.chunked_array([batch["run"]]))
        for code in np.unique(codes):
            rows = batch if len(names) == 1 else batch.filter(pa.array(codes == code))
            of_runs.setdefault(names[code], []).append(rows)
    return {run: _in_order(pa.Table.from_batches(parts)) for run, parts in of_runs.items()}


def _in_order(episodes: pa.Table) -> Points:
    """Returns the training episodes of a run in order."""
    number = episodes["episode"].to_numpy()
    columns = [numbers(episodes, name) for name in POINT]
    if (np.diff(number) < 0).any():  # most are in order
        order = np.argsort(number, kind="stable")
        columns = [column[order] for column in columns]
    return Points(*[*columns, *_single_episodes(len(number))])


def _evaluation_points(evaluations: pa.Table) -> dict[str, Points]:
    """Returns the evaluations of each run in order, each the mean over its episodes."""
    names, codes = coded(evaluations["run"])
    frame = pd.DataFrame({name: numbers(evaluations, name) for name in POINT})
    keys = [codes, evaluations["evaluation"].to_numpy()]
    how = {"episode_return": "mean", "control_steps": "max", "processor_time": "max"}
    grouped = frame.groupby(keys)  # ignores NaN, and sorts by run and evaluation
    returns = grouped["episode_return"]
    points = grouped.agg(how).assign(deviation=returns.std(), count=returns.count())
    counts = np.bincount(points.index.get_level_values(0), minlength=len(names))
    parts = np.split(points.to_numpy(np.float64).T, np.cumsum(counts)[:-1], axis=1)
    return {run: Points(*part) for run, part in zip(names, parts, strict=False) if part.size}


def coded(run: pa.ChunkedArray) -> tuple[list[str], IntArray]:
    """Returns the ids of runs, and for each row the index of its run."""
    if pa.types.is_dictionary(run.type):
        array = run.unify_dictionaries().combine_chunks()
    else:
        array = run.combine_chunks().dictionary_encode()
    return array.dictionary.to_pylist(), array.indices.to_numpy()


def numbers(table: pa.Table, name: str) -> FloatArray:
    """Returns a column with non-finite values replaced by NaN."""
    values = np.asarray(table[name].to_numpy(), np.float64)
    finite = np.isfinite(values)
    return values if finite.all() else np.where(finite, values, np.nan)
