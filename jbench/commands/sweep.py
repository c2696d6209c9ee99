"""The sweep command."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument, Option

from jbench import names
from jbench.commands import completion, options, parsing
from jbench.commands.output import Output
from jbench.commands.train import check_failures, check_runs, train_cells
from jbench.errors import RequestError, WorkError
from jbench.seeds import parse_numbers
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jbench.store import Results
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Executor

_MAX_SEEDS = 30


def sweep(
    matrix: str = Argument(
        ...,
        help=f"Matrix of runs: {', '.join(names.SWEEPS)}, or a FILE.toml.",
        autocompletion=completion.complete(*names.SWEEPS),
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
        None,
        "--seeds",
        "--seed",
        help="Seeds to train, such as 0-9 or 0,2,5-7 (default: those of the matrix).",
    ),
    steps: int | None = Option(
        None,
        parser=parsing.count,
        help="Number of control steps of each run (default: that of the matrix).",
    ),
    until_decided: bool = Option(
        False,
        "--until-decided",
        help="Add seeds in blocks of five until the comparisons of the matrix are decided, by "
        "default those of each representation with full and scaled.",
    ),
    max_seeds: int | None = Option(
        None,
        help="With --until-decided: maximum number of seeds of a configuration (default: "
        f"{_MAX_SEEDS}).",
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
    from jbench.commands.sweep_view import show_missing, show_status
    from jbench.sweeps.cell import all_runs, matrix_cells
    from jbench.sweeps.executors import Local, default_jobs
    from jbench.sweeps.matrix import read_matrix
    from jbench.training.status import failures_among, run_statuses

    output, database = Output(json), parsing.results_to_write(results)
    if not until_decided and (claims or max_seeds is not None):
        raise RequestError("COMPARISON and --max-seeds are for --until-decided.")
    if until_decided and seeds is not None:
        raise RequestError("--until-decided chooses the seeds; type --max-seeds, not --seeds.")
    changes: dict[str, Any] = {} if steps is None else {"steps": steps}
    limit = _MAX_SEEDS if max_seeds is None else max_seeds
    if until_decided:
        changes["seeds"] = _seeds_to_compare(matrix, limit)
    elif seeds is not None:
        changes["seeds"] = parse_numbers(seeds)
    parts = read_matrix(matrix, **changes)
    train_on = _device(executor, address, gpus_per_task, parts[0].engine, device)
    at_a_time = jobs or default_jobs(train_on)
    worker: dict[str, Any] = {"final_episodes": final_episodes, "keep_state": keep_state}
    worker["checkpoint_every"] = checkpoint_every

    def make() -> "Executor":
        if executor == "local":
            return Local(database, at_a_time, train_on, **worker)
        from jbench.sweeps.cluster import Ray

        return Ray(database, address, jobs, gpus_per_task, **worker)

    how: dict[str, Any] = {"device": device, "retry_failed": retry_failed}

    def train(cells: "Sequence[Cell]") -> dict[str, str]:
        return train_cells(cells, database, make, log, output, **how)

    cells = matrix_cells(parts, database)
    check_runs([cell.runs[0] for cell in cells], keep_state, output)
    if until_decided:
        _decide(matrix, cells, claims or [], database, limit, None if dry_run else train, output)
        return
    runs = list(all_runs(cells))
    failures = {} if dry_run else train(cells)
    title = f"{matrix}: {counted(len(runs), 'run')}"
    status = show_status(title, cells, database, at_a_time, train_on, output, times=dry_run)
    status["made_first"] = show_missing(cells, database, output)
    failures |= failures_among(run_statuses(runs, database))
    output.document({"matrix": matrix, **status, "failures": failures})
    if not dry_run:
        check_failures(failures, len(runs))
        output.say(f"Next: {with_results('jbench report', results)}")


def _seeds_to_compare(matrix: str, max_seeds: int) -> list[int]:
    """Returns all seeds that a comparison of a matrix may need."""
    from jbench.statistics.sequential import BLOCK
    from jbench.sweeps.matrix import read_comparisons

    if max_seeds < BLOCK or max_seeds % BLOCK:
        raise RequestError(f"--max-seeds {max_seeds}: type a multiple of {BLOCK}.")
    planned = (entry.max_seeds or 0 for entry in read_comparisons(matrix))
    return list(range(max([max_seeds, *planned])))


def _decide(
    matrix: str,
    cells: "Sequence[Cell]",
    claims: "Sequence[str]",
    results: "Results",
    max_seeds: int,
    train: "Callable[[Sequence[Cell]], object] | None",
    output: Output,
) -> None:
    """Adds seeds until the claims are decided; if `train` is None, shows the runs needed next."""
    from jbench.commands.sweep_view import described_outcomes, introduction, show_outcomes
    from jbench.sweeps.cell import all_runs
    from jbench.sweeps.comparisons import comparisons
    from jbench.sweeps.deciding import next_cells, outcomes
    from jbench.sweeps.matrix import Claim, read_comparisons
    from jbench.training.status import failures_among, run_statuses

    chosen = comparisons(cells, read_comparisons(matrix), claims, max_seeds)
    output.say(introduction(chosen, max_seeds))
    returns, tried = dict[tuple[str, Claim], float](), set[str]()
    while True:  # an interim analysis of all comparisons
        reached = outcomes(chosen, results, returns)
        needed_next = next_cells(reached, tried)
        show_outcomes(reached, tried, output)
        if not needed_next or train is None:
            break
        tried |= {run.id for run in all_runs(needed_next)}
        train(needed_next)
    needed = [run.id for run in all_runs(needed_next)]
    if needed:
        configurations = counted(len(needed_next), "configuration")
        output.say(f"Needed next: {counted(len(needed), 'run')} in {configurations}.")
    unfinished = (run for outcome in reached for run in outcome.needed)
    failures = failures_among(run_statuses(unfinished, results))
    output.document(
        {
            "matrix": matrix,
            "comparisons": described_outcomes(reached),
            "needed": needed,
            "failures": failures,
        }
    )
    if train is not None:
        if failures:
            raise WorkError(f"{counted(len(failures), 'run')} failed; --retry-failed tries again.")
        output.say(f"Next: {with_results('jbench report', results.name)}")


def _device(
    executor: str,
    address: str | None,
    gpus_per_task: float,
    engine: names.Engine | None,
    device: str,
) -> str:
    """Returns the device that the batched engine trains on, `cpu`, `cuda` or such as `cuda:1`."""
    from jbench.training.request import training_device

    if executor == "local":
        if address is not None or gpus_per_task:
            raise RequestError("--address and --gpus-per-task are for --executor ray.")
        return training_device(engine, device)
    if device != "auto":
        raise RequestError("--device is for --executor local; type --gpus-per-task.")
    if gpus_per_task and engine == "sb3":
        raise RequestError("--gpus-per-task is for the batched engine; this matrix uses sb3.")
    return "cuda" if gpus_per_task else "cpu"
