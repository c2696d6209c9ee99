"""The command sweep: a matrix of configurations."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument, Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.commands.stopped import stopped_cells
from jbench.errors import RequestError
from jbench.wording import with_results

if TYPE_CHECKING:
    from jbench.store import Results
    from jbench.studies.matrix import Matrix
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.scheduler import Executor


def sweep(
    matrix: str = Argument(
        ...,
        help=f"Matrix of runs: {', '.join(names.SWEEPS)}, or a FILE.toml.",
        autocompletion=lambda: names.SWEEPS,
    ),
    comparisons: list[str] = Argument(
        None,
        metavar="COMPARISON",
        help="With --until-decided: what to decide, such as dae12/full, or dae12 for all its "
        "comparisons (default: all).",
    ),
    only: str | None = Option(
        None,
        metavar="NAME,…",
        help="Only some of the matrix: the names of parts, tasks, algorithms or representations, "
        "such as face_direction,dae12.",
    ),
    dry_run: bool = options.DRY_RUN_OR_STATUS,
    retry_failed: bool = options.RETRY_FAILED,
    seeds: str | None = Option(
        None, "--seeds", "--seed", help="Seeds, such as 0-9 or 0,2,5-7 (default: the matrix's)."
    ),
    steps: int | None = options.whole_number(
        None,
        unit="STEPS",
        least=1,
        help="Control steps of each run (default: the matrix's).",
    ),
    until_decided: bool = Option(
        False,
        "--until-decided",
        help="Add seeds in blocks of five until the comparisons of the matrix are decided, by "
        "default those of each representation with full and scaled.",
    ),
    max_seeds: int | None = options.whole_number(
        None,
        unit="SEEDS",
        help="With --until-decided: largest number of seeds of a configuration (default: "
        f"{names.MAX_SEEDS}).",
    ),
    executor: names.ExecutorName = Option(
        "local", help="Where runs are trained: local (this machine) or ray (a Ray cluster)."
    ),
    address: str | None = Option(
        None, help="Address of the Ray cluster (default: RAY_ADDRESS, else a local Ray)."
    ),
    gpus_per_task: float = options.number(
        0.0,
        unit="GPUS",
        least=0,
        help="With --executor ray: GPUs per process; may be a fraction.",
    ),
    device: str = options.DEVICE,
    checkpoint_every: float = options.CHECKPOINT_EVERY,
    keep_state: bool = options.KEEP_STATE,
    keep_compact_state: bool = options.KEEP_COMPACT_STATE,
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    final_episodes: int | None = options.FINAL_EPISODES,
    log: names.LoggerName | None = options.LOG,
    jobs: int = options.JOBS,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Train the missing runs of a matrix of settings.

    A matrix has tasks, algorithms, representations and seeds.
    """
    from jbench.commands import training
    from jbench.commands.run_checks import check_runs
    from jbench.commands.sweep_status import show_cells
    from jbench.commands.until_decided import add_seeds_until_decided
    from jbench.sweeps.cell import all_runs, matrix_cells
    from jbench.sweeps.cluster import Ray
    from jbench.sweeps.executors import Local, default_jobs

    database = parsing.results_to_write(results)
    _check_seeds(until_decided, seeds, only, comparisons, max_seeds)
    limit = names.MAX_SEEDS if max_seeds is None else max_seeds
    chosen_seeds = _seeds(matrix, seeds, until_decided, limit)
    parts = _chosen_parts(matrix, only, steps=steps, seeds=chosen_seeds)
    train_on = _device(executor, address, gpus_per_task, parts.values(), device)
    at_once = jobs or default_jobs(train_on)
    keep = parsing.state_to_keep(keep_state, keep_compact_state)
    worker = training.worker_options(keep, final_episodes, checkpoint_every)
    executors: dict[str, Callable[[], Executor]] = {
        "local": partial(Local, database, at_once, train_on, **worker),
        "ray": partial(Ray, database, address, jobs, gpus_per_task, **worker),
    }
    train = partial(
        training.train_cells,
        results=database,
        make_executor=executors[executor],
        log=log,
        device=device,
        retry_failed=retry_failed,
    )

    cells = matrix_cells(parts, database, accept_changed_code)
    output.if_stopped(partial(stopped_cells, cells, database))
    measured = train_on if executor == "local" else None
    check_runs([cell.runs[0] for cell in cells], keep, measured, final_episodes)
    if until_decided:
        asked = comparisons or []
        train_more = None if dry_run else train
        document, count = add_seeds_until_decided(
            matrix, parts, cells, asked, database, limit, train_more
        )
    else:
        failures = {} if dry_run else train(cells)
        count = len(all_runs(cells))
        document = show_cells(matrix, cells, database, at_once, train_on, dry_run, final_episodes)
        document |= _missing_and_failed(matrix, cells, database, failures)

    output.document({"matrix": matrix, **document})
    if not dry_run:
        training.check_failures(document["failures"], count, database)
        output.say(f"Next: {with_results('jbench report', results)}")


def _missing_and_failed(
    matrix: str, cells: Sequence["Cell"], results: "Results", failures: dict[str, str]
) -> dict[str, Any]:
    """Prints what has to be made first; returns it, and the failures of now and of before."""
    from jbench.commands import training
    from jbench.sweeps.cell import all_runs
    from jbench.training.status import failures_among, run_statuses

    missing = training.show_missing(cells, results, matrix)
    before = failures_among(run_statuses(all_runs(cells), results))
    return {"made_first": missing, "failures": failures | before}


def _check_seeds(
    until_decided: bool,
    seeds: str | None,
    only: str | None,
    comparisons: list[str] | None,
    max_seeds: int | None,
) -> None:
    """Raises a RequestError for options that do not go with `--until-decided`, or not without."""
    if until_decided and seeds is not None:
        raise RequestError("--until-decided chooses the seeds; type --max-seeds, not --seeds.")
    if until_decided and only is not None:
        raise RequestError("--until-decided decides whole comparisons; name them, without --only.")
    if not until_decided and (comparisons or max_seeds is not None):
        raise RequestError("COMPARISON and --max-seeds are for --until-decided.")


def _seeds(matrix: str, typed: str | None, until_decided: bool, limit: int) -> list[int] | None:
    """Returns the seeds of each configuration; None for those of the matrix."""
    from jbench.commands.until_decided import seeds_to_compare

    if until_decided:
        return seeds_to_compare(matrix, limit)
    if typed is not None:
        return parsing.seeds(typed)
    return None


def _chosen_parts(
    matrix: str, only_some: str | None, **typed: int | list[int] | None
) -> dict[str, "Matrix"]:
    """Returns the parts of a matrix that a user wants, with the settings that the user typed."""
    from jbench.studies.comparisons import check_comparisons
    from jbench.studies.matrix import only, read_matrix

    check_comparisons(matrix)
    changes = {name: value for name, value in typed.items() if value is not None}
    return only(read_matrix(matrix, **changes), parsing.names_of_matrix(only_some))


def _device(
    executor: str, address: str | None, gpus: float, parts: Iterable["Matrix"], device: str
) -> str:
    """Returns the device that the batched engine trains on, `cpu`, `cuda` or such as `cuda:1`."""
    from jbench.devices import check_precision
    from jbench.settings.engines import ENGINES
    from jbench.training.request import training_device

    if executor == "local":
        if address is not None or gpus:
            raise RequestError("--address and --gpus-per-task are for --executor ray.")
        devices = [training_device(part.engine, device, part.precision) for part in parts]
        return next((device for device in devices if device != "cpu"), "cpu")

    if device != "auto":
        raise RequestError("--device is for --executor local; type --gpus-per-task.")

    train_on = "cuda" if gpus else "cpu"
    for part in parts:
        check_precision(part.precision, train_on)
        if gpus and part.engine is not None and not ENGINES[part.engine].is_for_gpu:
            raise RequestError(
                f"--gpus-per-task is for the batched engine; this matrix uses {part.engine}."
            )

    return train_on
