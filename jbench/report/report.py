"""From a results directory to a report's files."""

import io
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure

from jbench.errors import RequestError, WorkError
from jbench.names import ORDERS, Order
from jbench.report import behaviour, encoders, figures, page, panels, sequences
from jbench.report.cells import Cell, build_cells, file_name, usable_runs
from jbench.report.curves import (
    QUANTILES,
    WINDOW,
    Curve,
    final_returns,
    learning_curve,
    quantiles_across_seeds,
)
from jbench.report.drawing import LearnedCurve
from jbench.report.published import (
    PPO_ENVIRONMENTS,
    SEQUENCE_ROBOTS,
    PublishedCurve,
    best_median,
    read_published,
    read_sequences,
)
from jbench.store import query
from jbench.store.database import Results
from jbench.store.files import make_directory, write_atomic

_KEY = ("task", "algo", "representation", "variant")
_COLUMNS = [
    *_KEY,
    *("settings", "seeds", "episodes_min", "episodes_max"),
    *("final_return_median", "final_return_q10", "final_return_q90", "control_steps"),
    *("published_median", "published_figure", "notes"),
]


@dataclass(frozen=True)
class Report:
    """What was reported, and where it lies.

    Attributes:
        table: a row for each cell, in the order of the paper; see `summary_table`.
        aggregate: a row for each point of each curve; see `aggregate_curves`.
        figures: the PNG and SVG files.
        files: all files written, figures and page among them.
        problems: a sentence for each part of the results that can't be read; the rest is reported.
        notes: a sentence for each thing that a reader of the curves should know.
    """

    table: pd.DataFrame
    aggregate: pd.DataFrame
    figures: list[Path]
    files: list[Path]
    problems: list[str]
    notes: list[str]


def write_report(
    results: Results,
    out: Path,
    *,
    order: Order = "quantile-first",
    window: int = WINDOW,
    task: str | None = None,
    algo: str | None = None,
) -> Report:
    """Aggregates all runs over their seeds and writes tables, figures and a page.

    Args:
        results: where the runs are.
        out: directory for the files; made if need be.
        order: of quantiles and smoothing: `quantile-first` (Figure 9) or `smooth-first` (Figure 8).
        window: episodes in a moving average; short runs get less, see `curves.fitting_window`.
        task: report this task only.
        algo: report this algorithm only.

    Raises:
        RequestError: if there are no runs, or none that the filters let through; if the order or
            the window is not one; or if nothing can be written in `out`.
        WorkError: if there are runs, but none can be read; or the disk is full.
    """
    _check_request(order, window)
    tables, problems = query.load(results)
    runs, unusable = usable_runs(tables["runs"])
    seen, unread = behaviour.behaviours(results, task)
    problems = [*problems, *unusable, *unread]
    reduced = encoders.encoder_table(tables, task)
    # Policies that were only evaluated, and encoders, can be drawn without any run.
    drawable = bool(seen) or not reduced.empty
    if runs.empty and (algo is not None or not drawable):
        raise _nothing_to_report(results, problems)
    if not runs.empty:
        runs = _filter(runs, task, algo)
    cells, notes = build_cells(runs, tables["episodes"])
    if not cells and not drawable:
        raise RequestError(f"No run has an episode yet; wait for them. {' '.join(notes)}")
    # The figures choose from these by the paper's figure.
    published = [*read_published(tables["published"]), *read_sequences(tables["published"])]
    learned = [LearnedCurve(cell, _curve(cell, order, window)) for cell in cells]
    notes += _sentences(learned, published, window)
    table = summary_table(learned, published, window)
    aggregate = aggregate_curves(learned)
    more = {**behaviour.draw(seen), **encoders.draw(reduced)}
    pictures = _draw(learned, published, order, window, more)
    contents = {
        "aggregate.parquet": _to_parquet(aggregate),
        "aggregate.csv": query.to_csv(aggregate).encode(),
        "table.csv": query.to_csv(table).encode(),
        **({} if reduced.empty else {"encoders.csv": query.to_csv(reduced).encode()}),
        **pictures,
        "index.html": page.render(table, reduced, pictures, notes, problems).encode(),
    }
    files = _write(out, contents)
    drawn = [path for path in files if path.name in pictures]
    return Report(table, aggregate, drawn, files, problems, notes)


def aggregate_curves(learned: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns the points of all curves, sorted by their cells' names and control steps.

    Columns: task, algo, representation, variant, order, window (episodes), control_steps (centre
    of the window), seeds, and the episode return's quantiles q10, q25, q50, q75, q90.
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

    Columns: task, algo, representation, variant, settings (those that set a variant apart), seeds,
    episodes_min, episodes_max, final_return_median, final_return_q10, final_return_q90 (across
    seeds; a final return is the mean of a run's last 100 episodes or last quarter), control_steps
    (centre of those episodes, the seeds' median), published_median and published_figure (best of
    the paper there; missing where its curves don't reach; on robots in turn where ours is), notes.
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


def _sentences(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve], window: int
) -> list[str]:
    return [
        f"{item.cell.name}: {note}."
        for item in learned
        for note in cell_notes(item, published, window)
    ]


def _curve(cell: Cell, order: Order, window: int) -> Curve:
    return learning_curve(cell.returns, cell.control_steps, cell.lengths, order, window)


def _check_request(order: str, window: int) -> None:
    if order not in ORDERS:
        raise RequestError(f"There is no order {order!r}; choose {' or '.join(ORDERS)}.")
    if window < 1:
        raise RequestError(f"A window of {window} episodes is none; choose 1 or more.")


def _nothing_to_report(results: Results, problems: Sequence[str]) -> RequestError | WorkError:
    """Returns the error for results without a run that can be reported."""
    records, unreadable = results.scan("run")
    if records or unreadable:
        return WorkError(f"No run in {results.path} can be reported. {' '.join(problems)}")
    return RequestError(
        f"There are no runs in {results.path}; run "
        "`jbench train --task face_direction --steps 100000 --seeds 0-1` first."
    )


def _filter(runs: pd.DataFrame, task: str | None, algo: str | None) -> pd.DataFrame:
    """Returns the runs asked for, of which there is at least one."""
    wanted = pd.Series(True, index=runs.index)
    for name, value in (("task", task), ("algo", algo)):
        if value is not None:
            wanted &= runs[name] == value
    if not wanted.any():
        there = "; ".join(
            f"{name} with {', '.join(sorted(set(group)))}"
            for name, group in runs.groupby("task")["algo"]
        )
        asked = " and ".join(
            f"{name} {value!r}"
            for name, value in (("task", task), ("algo", algo))
            if value is not None
        )
        raise RequestError(f"There are no runs of {asked}; there are runs of {there}.")
    return runs[wanted]


def _draw(
    learned: Sequence[LearnedCurve],
    published: Sequence[PublishedCurve],
    order: Order,
    window: int,
    more: Mapping[str, Figure],
) -> dict[str, bytes]:
    """Returns the files of these curves' figures, and of more figures, by name."""
    drawn = {}
    one_robot = [item for item in learned if item.cell.robots <= 1]
    if one_robot:
        drawn["figure9"] = figures.grid_figure(one_robot, published, order, window)
    comparisons = figures.comparison_figures(one_robot, published, order, window)
    for (task, algo), figure in comparisons.items():
        drawn[file_name("comparison", task, algo)] = figure
    for (task, algo), figure in sequences.sequence_figures(learned, published, order).items():
        drawn[file_name("robots", task, algo)] = figure
    files = {}
    for name, figure in {**drawn, **more}.items():
        files[f"{name}.png"] = panels.to_png(figure)
        files[f"{name}.svg"] = panels.to_svg(figure)
    return files


def _write(out: Path, contents: Mapping[str, bytes]) -> list[Path]:
    make_directory(out)
    for name, content in contents.items():
        write_atomic(out / name, content)
    return [out / name for name in contents]


def _to_parquet(frame: pd.DataFrame) -> bytes:
    sink = io.BytesIO()
    rows = pa.Table.from_pandas(frame, preserve_index=False, nthreads=1)
    pq.write_table(rows, sink, compression="zstd")
    return sink.getvalue()
