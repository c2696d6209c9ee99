"""The runs and imports of a results directory, from their manifests."""

import math
from collections.abc import Collection, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from jbench.errors import WorkError
from jbench.names import EPISODE_STEPS, RETURNS, ReturnsName
from jbench.returns import final_evaluation, final_return
from jbench.settings.alike import variant
from jbench.settings.recorded import Run, Unreadable, read_run
from jbench.settings.variants import variant_words
from jbench.store.database import Results
from jbench.store.record import Record


class RunLine(NamedTuple):
    """A run in a list of runs; values that its manifest lacks or that have a wrong type are None.

    Attributes:
        run: id of the run.
        status: unfinished, finished or failed.
        episodes: number of committed episodes; of an import, its points.
        steps_done: control steps of these episodes, or of the finished run.
        steps: requested control steps.
        wall_time: s; of a finished run, or up to its last episode if returns are requested.
        last_return: final training return (`jbench.returns`) if requested; of an import, the final
            return of its kind.
        created, updated: UTC, ISO 8601.
        returns: kind of return of an import; None for a run.
        error: why a failed run failed; None for other runs.
        variant: the settings in which the listed runs of the same task, algorithm and
            representation differ, as in legends; empty for a single variant.
        evaluation_return: final evaluation return (`jbench.returns`) if requested.
    """

    run: str
    task: str | None
    algo: str | None
    representation: str | None
    seed: int | float | None
    status: str
    episodes: int
    steps_done: int | float
    steps: int | float | None
    wall_time: float | None
    last_return: float | None
    created: str
    updated: str
    returns: ReturnsName | None = None
    error: str | None = None
    variant: str = ""
    evaluation_return: float | None = None


def list_runs(
    results: Results,
    filters: Mapping[str, Collection[Any]],
    returns: bool = False,
    kind: Literal["run", "import"] = "run",
) -> tuple[list[RunLine], list[str]]:
    """Returns the runs, oldest first, and an error for each unreadable one.

    Args:
        filters: allowed values by field of `RunLine`.
        returns: whether to read the episodes for the final returns.
    """
    records, problems = results.scan(kind)
    lines: list[tuple[RunLine, Record]] = []
    for record in records:
        line = make_line(record)
        if matches(line, filters):
            try:
                lines.append((_with_returns(line, record) if returns else line, record))
            except WorkError as error:
                problems.append(str(error))
    return _with_variants(lines), problems


def _with_variants(lines: list[tuple[RunLine, Record]]) -> list[RunLine]:
    """Returns the lines with the variants of their records, if their settings are readable."""
    cells: dict[tuple[str | None, ...], dict[str, Run]] = {}
    keys = [((line.algo, line.representation), variant(record.settings)) for line, record in lines]
    for (cell, key), (_, record) in zip(keys, lines, strict=True):
        run = read_run(record.settings)
        if not isinstance(run, Unreadable):
            cells.setdefault(cell, {})[key] = run
    words = {
        (cell, key): text
        for cell, variants in cells.items()
        for key, text in variant_words(variants).items()
    }
    named = zip(lines, keys, strict=True)
    return [line._replace(variant=words.get(key, "")) for (line, _), key in named]


def matches(line: RunLine, filters: Mapping[str, Collection[Any]]) -> bool:
    """Returns whether each field that is filtered has one of the allowed values."""
    return all(getattr(line, name) in values for name, values in filters.items())


def setting_values(results: Results, setting: str) -> set[str]:
    """Returns the text values of a setting, such as `algo`, in the readable runs and imports."""
    records = [*results.scan("run")[0], *results.scan("import")[0]]
    values = (record.settings.get(setting) for record in records)
    return {value for value in values if isinstance(value, str)}


def make_line(record: Record) -> RunLine:
    """Returns the line of a run or an import, without its final returns."""
    settings, manifest = read_run(record.settings), record.manifest
    is_import = record.kind == "import"
    summary = {name: _number(value) for name, value in manifest.summary.items()}
    episodes = int(summary.get("points") or 0) if is_import else record.rows("episodes")
    done = summary.get("control_steps" if is_import else "steps_done")
    returns = record.settings.get("returns") if is_import else None
    return RunLine(
        run=record.id,
        task=settings.task,
        algo=settings.algo,
        representation=settings.representation,
        seed=settings.seed,
        status=manifest.status,
        episodes=episodes,
        steps_done=(0 if is_import else episodes * EPISODE_STEPS) if done is None else done,
        steps=settings.steps,
        wall_time=None if is_import else summary.get("wall_time"),
        last_return=None,
        created=manifest.created,
        updated=manifest.updated,
        returns=returns if returns in RETURNS else None,
        error=record.error,
    )


def _with_returns(line: RunLine, record: Record) -> RunLine:
    if record.kind == "import":
        points = record.read("import_points").to_pandas()
        returns = points.groupby("point")["episode_return"].mean().to_numpy(np.float64)
        if line.returns == "evaluation":
            final = final_return(returns[-1:])
            return line._replace(last_return=final, evaluation_return=final)
        return line._replace(last_return=final_return(returns))
    rows = record.read("episodes")
    if not len(rows):
        return line
    final = final_return(rows["episode_return"].to_numpy())
    time = line.wall_time if line.wall_time is not None else rows["wall_time"][-1].as_py()
    return line._replace(
        last_return=final, evaluation_return=evaluation_return(record), wall_time=_number(time)
    )


def evaluation_return(record: Record) -> float | None:
    """Returns the final evaluation return of a run; see `jbench.returns`."""
    rows = record.read("evaluations")
    return final_evaluation(rows["evaluation"].to_numpy(), rows["episode_return"].to_numpy())


def _number(value: Any) -> int | float | None:
    """Returns a value of an untrusted manifest if it is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return value
