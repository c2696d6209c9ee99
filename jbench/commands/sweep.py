"""The sweep command."""

from functools import partial
from pathlib import Path
from typing import Any

from typer import Argument, Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError
from jbench.wording import counted, with_results

_MAX_SEEDS = 30


def sweep(
    matrix: str = Argument(
        ...,
        help=f"Matrix of runs: {', '.join(names.SWEEPS)}, or a FILE.toml.",
        autocompletion=lambda: names.SWEEPS,
    ),
    claims: list[str] = Argument(
        None,
        metavar="COMPARISON",
        help="With --until-decided: what to decide, such as dae12/full, or dae12 for all its "
        "comparisons (default: all).",
    ),
    dry_run: bool = options.DRY_RUN,
    retry_failed: bool = options.RETRY_FAILED,
    seeds: str | None = Option(
        None, "--seeds", "--seed", help="Seeds, such as 0-9 or 0,2,5-7 (default: the matrix's)."
    ),
    steps: int | None = Option(
        None, parser=parsing.count, help="Control steps of each run (default: the matrix's)."
    ),
    until_decided: bool = Option(
        False,
        "--until-decided",
        help="Add seeds in blocks of five until the comparisons of the matrix are decided, by "
        "default those of each representation with full and scaled.",
    ),
    max_seeds: int | None = Option(
        None, help=f"With --until-decided: most seeds of a configuration (default: {_MAX_SEEDS})."
    ),
    executor: names.Executor = Option(
        "local", help="Where runs are trained: local (this machine) or ray (a Ray cluster)."
    ),
    address: str | None = Option(
        None, help="Address of the Ray cluster (default: RAY_ADDRESS, else a local Ray)."
    ),
    gpus_per_task: float = Option(
        0.0, min=0, help="With --executor ray: GPUs per process; may be a fraction."
    ),
    device: str = options.DEVICE,
    checkpoint_every: float = options.CHECKPOINT_EVERY,
    keep_state: bool = options.KEEP_STATE,
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
    from jbench.commands.deciding import decide, seeds_to_compare
    from jbench.sweeps.cell import all_runs, matrix_cells
    from jbench.sweeps.executors import Local, Ray, default_jobs
    from jbench.sweeps.matrix import read_matrix
    from jbench.training.status import failures_among, run_statuses

    output, database = Output(json), parsing.results_to_write(results)
    if not until_decided and (claims or max_seeds is not None):
        raise RequestError("COMPARISON and --max-seeds are for --until-decided.")
    if until_decided and seeds is not None:
        raise RequestError("--until-decided chooses the seeds; type --max-seeds, not --seeds.")
    limit = _MAX_SEEDS if max_seeds is None else max_seeds
    chosen = names.parse_numbers(seeds) if seeds is not None else None
    typed = {"steps": steps, "seeds": seeds_to_compare(matrix, limit) if until_decided else chosen}
    parts = read_matrix(matrix, **{key: value for key, value in typed.items() if value is not None})
    train_on = _device(executor, address, gpus_per_task, next(iter(parts.values())).engine, device)
    at_once = jobs or default_jobs(train_on)
    worker: dict[str, Any] = {"keep_state": keep_state, "final_episodes": final_episodes}
    worker["checkpoint_every"] = checkpoint_every
    local = partial(Local, database, at_once, train_on, **worker)
    cluster = partial(Ray, database, address, jobs, gpus_per_task, **worker)
    train = partial(
        training.train_cells,
        results=database,
        make_executor=local if executor == "local" else cluster,
        output=output,
        log=log,
        device=device,
        retry_failed=retry_failed,
    )
    cells = matrix_cells(parts, database)
    training.check_runs([cell.runs[0] for cell in cells], keep_state, output)
    if until_decided:
        decide(matrix, cells, claims or [], database, limit, None if dry_run else train, output)
        return
    runs = all_runs(cells)
    failures = {} if dry_run else train(cells)
    title = f"{matrix}: {counted(len(runs), 'run')}"
    status = training.show_status(title, cells, database, at_once, train_on, output, times=dry_run)
    status["made_first"] = training.show_missing(cells, database, output)
    failures |= failures_among(run_statuses(runs, database))
    output.document({"matrix": matrix, **status, "failures": failures})
    if not dry_run:
        training.check_failures(failures, len(runs))
        output.say(f"Next: {with_results('jbench report', results)}")


def _device(
    executor: str, address: str | None, gpus: float, engine: names.Engine | None, device: str
) -> str:
    """Returns the device that the batched engine trains on, `cpu`, `cuda` or such as `cuda:1`."""
    from jbench.training.request import training_device

    if executor == "local":
        if address is not None or gpus:
            raise RequestError("--address and --gpus-per-task are for --executor ray.")
        return training_device(engine, device)
    if device != "auto":
        raise RequestError("--device is for --executor local; type --gpus-per-task.")
    if gpus and engine == "sb3":
        raise RequestError("--gpus-per-task is for the batched engine; this matrix uses sb3.")
    return "cuda" if gpus else "cpu"
