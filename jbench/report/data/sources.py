"""Sources of a report: the results, imports, the shipped runs, or two sides of a comparison."""

import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbench.errors import NothingYetError
from jbench.importing.curves import as_imports, as_runs
from jbench.importing.dialects import read_curves
from jbench.names import REFERENCE
from jbench.report.data.build import build, usable_runs
from jbench.report.data.chosen import have_settings
from jbench.report.data.configuration import Configuration
from jbench.report.data.order import paper_order
from jbench.report.data.points import PATHS, POINT, run_paths
from jbench.report.data.source_names import FILE, IMPORTED, OWN
from jbench.report.request import Request, is_directory
from jbench.returns import EVALUATION
from jbench.settings.code_words import encoder_words
from jbench.store import Results, schema
from jbench.store.evaluations import ADDED, with_added_episodes
from jbench.store.shipped import results_to_read
from jbench.store.tables import Tables, read_tables
from jbench.wording import are, counted, in_prose

_ADDED = ("policy_evaluations", "policy_episodes")  # which join the last evaluations of runs
_RUNS = ("runs", "episodes", "evaluations", "paths", "encoders", *_ADDED)
_MORE = ("encoder_errors", "encoder_features", "encoder_predictions", "metrics")
_COLUMNS = {
    "episodes": ("run", "episode", *POINT),
    "evaluations": ("run", "evaluation", "episode", *POINT),
    "paths": PATHS,
}
_EVALUATED = pa.schema(
    [schema.EVALUATIONS.field(n) for n in ("run", "evaluation", "episode", "episode_return")]
)


@dataclass
class Source:
    """The runs of one results directory, of a selection of them, or of several."""

    configurations: list[Configuration]  # for both kinds of return
    runs: pd.DataFrame  # rows of the table `runs`, with a column `source`
    notes: list[str]  # sentences on runs that are in no configuration
    problems: list[str]  # a sentence for each unreadable record
    tables: dict[str, pd.DataFrame]  # of encoders, policies, metrics; of others than results empty
    paths: pd.DataFrame  # see `run_paths`
    evaluations: pa.Table  # rows of the table `evaluations`, those of `jbench evaluate` included
    shared: str = ""  # hyperparameters of all trained runs that are no defaults, if names lack them


def joined(parts: Sequence[Source]) -> Source:
    """Returns several sources as one, with the tables of the first."""
    return Source(
        sorted((config for part in parts for config in part.configurations), key=paper_order),
        pd.concat([part.runs for part in parts], ignore_index=True),
        [note for part in parts for note in part.notes],
        [problem for part in parts for problem in part.problems],
        parts[0].tables,
        pd.concat([part.paths for part in parts], ignore_index=True),
        pa.concat_tables([part.evaluations for part in parts]),
    )


def own(results: Results, request: Request, name: str = OWN, *, strict: bool = True) -> Source:
    """Returns the runs that pass the filters; `strict`: none is an error."""
    return _source(_load(results, _MORE, request.filters), request, name, strict=strict)


def imported(results: Results, request: Request, name: str = IMPORTED) -> Source:
    """Returns the imported curves of the requested task and algorithm; they have no date."""
    request = request.model_copy(update={"since": None})
    tables, problems = read_tables(results, ("imports", "import_points"))
    imports = tables["imports"].to_pandas(use_threads=False)
    points = tables["import_points"].to_pandas(use_threads=False)
    made = as_runs(_filtered(imports, request, strict=False)[0], points)
    source = _source(Tables(made.tables, problems + made.problems), request, name, strict=False)
    if source.configurations:
        source.notes += made.notes

    _compare_over_run(source.configurations)
    return source


def own_and_imported(results: Results, request: Request) -> Source:
    """Returns the runs of the results, and the imported curves; see `own` for errors."""
    imports = imported(results, request)
    runs = own(results, request, strict=not imports.configurations)
    return joined([runs, imports] if imports.configurations or imports.problems else [runs])


def from_file(request: Request, path: Path) -> Source:
    """Returns the curves of a file, or of a folder, of the requested task and algorithm."""
    file = read_curves(path, request.returns)
    made = as_runs(*as_imports(file.points, request.returns))
    source = _source(Tables(made.tables, made.problems), request, FILE)
    source.notes += file.notes
    _compare_over_run(source.configurations)
    return source


def _compare_over_run(configurations: Sequence[Configuration]) -> None:
    """Makes the means over the run of methods on a task comparable, however each was logged."""
    by_task: dict[tuple[str, str], list[Configuration]] = {}
    for config in configurations:
        by_task.setdefault((config.task, config.returns_name), []).append(config)
    for methods in by_task.values():
        for config in methods:
            config.beside = [other for other in methods if other is not config]


def reference(request: Request, results: Results) -> Source:
    """Returns the runs shipped with jbench, which form separate configurations."""
    request = request.model_copy(update={"since": None})  # which selects runs of the user only
    read = _load(results, of_runs=request.filters)
    source = _source(read, request, REFERENCE, strict=False)
    if not source.configurations:
        source.notes.append("This version of jbench ships no reference runs for this report.")
    return source


def check_baseline(baseline: str, configurations: Sequence[Configuration]) -> None:
    """Raises a NothingYetError if no curve of the baseline was imported, or there are no others."""
    labels = sorted({config.algo for config in configurations if config.source == IMPORTED})
    if baseline not in labels:
        instead = f"one of {', '.join(labels)}" if labels else "jbench import to import some"
        reason = f"no curve of that label was imported; type {instead}."
    elif all((config.source, config.algo) == (IMPORTED, baseline) for config in configurations):
        reason = "there are no other curves to draw it beside; leave it out."
    else:
        return

    raise NothingYetError(f"--baseline {baseline}: {reason}")


def side(text: str, name: str, results: Results, request: Request) -> Source:
    """Returns the runs of one side of a comparison, as configurations of a source of this name.

    The text is a results directory, or settings of runs, such as `algo=td3,representation=dae12`; a
    RequestError if it is neither, or no run has the settings and passes the filters.
    """
    if is_directory(text):
        read = _load(results_to_read(text))
        source = _source(read, request, name)
    else:
        source = _source(_load(results), request, name, chosen=text)

    if not source.configurations:
        reasons = " ".join(source.problems)
        raise NothingYetError(f"There is no run with an episode of {text}. {reasons}".strip())
    return source


def _load(
    results: Results,
    more: Sequence[str] = (),
    of_runs: Mapping[str, Collection[str]] | None = None,
) -> Tables:
    """Reads the tables of runs that may have some settings, with texts as categories."""
    names = (*_RUNS, *more)
    return read_tables(results, names, coded=True, columns=_COLUMNS, of_runs=of_runs)


def _source(
    read: Tables, request: Request, name: str, *, chosen: str = "", strict: bool = True
) -> Source:
    """Returns the configurations of the runs that pass the filters, and what hinders others."""
    # The name of a directory may contain bytes that no table can hold.
    name = name.encode(errors="backslashreplace").decode()
    about = ("encoders", *_ADDED, *_MORE)
    known = {table: schema.TABLES[table].empty_table() for table in about} | read.tables
    tables = {table: known[table].to_pandas(use_threads=False) for table in about}
    runs, unusable = usable_runs(read.tables["runs"])
    if chosen:
        runs = runs[have_settings(chosen, runs)]

    runs, notes = _filtered(runs, request, strict)
    evaluations = with_added_episodes(read.tables["evaluations"], runs, tables)
    # Imported curves have no paths.
    paths = run_paths(read.tables.get("paths"), evaluations).assign(source=name)
    episodes = read.tables["episodes"]
    runs = runs.assign(source=name)
    encoders = _encoder_words(tables["encoders"])
    built, more = build(runs, episodes, evaluations, name, encoders) if len(runs) else ([], [])
    _note_added_episodes(built, evaluations)
    evaluated = evaluations.select(_EVALUATED.names).cast(_EVALUATED)
    problems = [*read.problems, *unusable]
    return Source(built, runs, notes + more, problems, tables, paths, evaluated)


def _encoder_words(encoders: pd.DataFrame) -> dict[str, str]:
    """Returns the names of encoders that differ only in the code of their kind, by id."""
    settings = map(json.loads, encoders["settings"])
    return encoder_words(zip(encoders["encoder"], settings, encoders["created"], strict=True))


def _note_added_episodes(built: Sequence[Configuration], evaluations: pa.Table) -> None:
    """Adds a note to configurations with returns that were not recorded at the end of training."""
    added = evaluations.filter(pc.field("episode") >= ADDED)["run"].to_pylist()
    counts = Counter(added)
    for config in built:
        seeds = sum(counts[run] > 0 for run in config.runs)
        if config.returns_name == EVALUATION and seeds:
            episodes = counted(sum(counts[run] for run in config.runs), "episode")
            which = counted(seeds, "seed")
            note = f"jbench evaluate added {episodes} to the last evaluations of {which}"
            config.notes = (*config.notes, note)


def _filtered(runs: pd.DataFrame, request: Request, strict: bool) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs of the requested time, task and algorithm, and a note on earlier ones."""
    notes = []
    since = request.begun_since()
    if since is not None:
        created = pd.to_datetime(runs["created"], utc=True, errors="coerce", format="ISO8601")
        earlier = int((~(created >= since)).sum())
        if earlier:
            left_out = f"begun before {request.since} {are(earlier)} left out."
            notes = [f"{counted(earlier, 'run')} {left_out}"]
            if strict and earlier == len(runs):
                raise NothingYetError(f"No run was begun since {request.since}. {notes[0]}")
            runs = runs[created >= since]

    wanted = request.filters
    matches = pd.Series(True, index=runs.index)
    for name, values in wanted.items():
        matches &= runs[name].isin(values)

    if strict and len(runs) and not matches.any():
        algos = runs.groupby("task")["algo"].unique()
        existing = "; ".join(f"{task} with {', '.join(sorted(a))}" for task, a in algos.items())
        missing = " and ".join(
            f"{name} {in_prose(map(repr, values))}" for name, values in wanted.items()
        )
        raise NothingYetError(f"There are no runs of {missing}; there are runs of {existing}.")

    return runs[matches], notes
